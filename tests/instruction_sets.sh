#!/bin/sh
# Run the quick tests of the numeric rooms as on older processors.
#
#     tests/instruction_sets.sh [PYTEST OPTION...]
#
# Numba, PyTorch and OpenBLAS choose instructions of this processor; rounding differs on others. Each set has
# a cache of kernels of its own below NUMBA_CACHE_DIR (default: a temporary folder that is removed).
set -u
cd "$(dirname "$0")/.." || exit 1
if [ -z "${NUMBA_CACHE_DIR:-}" ]; then
    NUMBA_CACHE_DIR=$(mktemp -d)
    trap 'rm -rf "$NUMBA_CACHE_DIR"' EXIT
fi
caches=$NUMBA_CACHE_DIR
failed=0
for pair in x86-64-v3:Haswell x86-64:Prescott; do
    echo "numba ${pair%:*}, OpenBLAS ${pair#*:}"
    NUMBA_CACHE_DIR=$caches/${pair%:*} NUMBA_CPU_NAME=${pair%:*} NUMBA_CPU_FEATURES='' \
        OPENBLAS_CORETYPE=${pair#*:} ATEN_CPU_CAPABILITY=default BOKEHNET_NO_PRECOMPILED=1 \
        python -m pytest -m 'not slow' tests/unit/classical tests/unit/optics tests/unit/engines \
        tests/unit/depth_repair tests/unit/io "$@" || failed=1
done
exit $failed
