#!/bin/sh
# The recipe of docs/use/hosts/overview.md for any farm that runs commands; run here by itself, in no farm's queue.
# render_chunk.sh FIRST LAST PICTURE.####.exr OUTPUT.####.exr [options of bokehnet render ...]
# Exit code 0: all frames of the chunk are there. 1: some failed, and are told; running it again renders these alone.
# 130, 143: interrupted or preempted; what was finished stays, no half of a file does. 2: wrong call.
set -u
if [ "$#" -lt 4 ]; then
  echo "render_chunk: error: expected FIRST LAST PICTURE OUTPUT, found $# words" >&2
  exit 2
fi
first=$1 last=$2 picture=$3 output=$4
shift 4
exec bokehnet render "$picture" -o "$output" --frames "$first-$last" --quiet "$@"
