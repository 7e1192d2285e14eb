"""Thread pools of the decoders in forked processes, which have only one of the parent's threads.

A child that hands work to an inherited pool waits for threads that do not exist. The pools are therefore
emptied before each fork, and filled again afterwards in the parent; children decode and encode on one thread.
"""

import os

import OpenImageIO as oiio  # noqa: N813

__all__: list[str] = []

# Number of threads of each pool, as OpenImageIO's attributes, for none besides the caller's.
_ALONE = {"threads": 1, "exr_threads": -1}

_counts: dict[str, int] = {}


def _empty_pools() -> None:
    for name, alone in _ALONE.items():
        _counts[name] = oiio.get_int_attribute(name, alone)
        oiio.attribute(name, alone)
    oiio.ImageOutput.create("exr")  # the number of OpenEXR's threads takes effect with the next file


def _fill_pools() -> None:
    for name, count in _counts.items():
        oiio.attribute(name, count)
    oiio.ImageOutput.create("exr")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_empty_pools, after_in_parent=_fill_pools)
