#!/bin/sh
# Recipe of docs/use/hosts/render_farm.md for any render farm that runs commands; tested stand-alone, not in a farm's queue.
# render_chunk.sh FIRST LAST PICTURE.####.exr OUTPUT.####.exr [options of bokehnet render ...]
# Exit code 0: all frames of the chunk exist. 1: some failed, with messages; a rerun renders only these.
# 130, 143: interrupted or preempted; finished frames remain, no partial file does. 2: wrong call.
set -u
if [ "$#" -lt 4 ]; then
  echo "render_chunk: error: expected FIRST LAST PICTURE OUTPUT, found $# words" >&2
  exit 2
fi
first=$1 last=$2 picture=$3 output=$4
shift 4
exec bokehnet render "$picture" -o "$output" --frames "$first-$last" "$@"
