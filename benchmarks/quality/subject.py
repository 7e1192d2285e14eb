"""Rate of pictures whose subject the automatic focus hits, against subjects chosen by hand.

    python -m benchmarks.quality.subject [--sheet subjects.png] [--faces]

Pictures: scenes rendered here by ray casting (ground, wall, spheres, posts, cards) with fair and poor maps;
photographs of scikit-image with a stereo map or with maps drawn here by hand; the demo; and, where
``../shared`` is present, its photographs and path-traced scenes. The subject of a scene was written down with
the scene, that of a photograph as a rectangle, before the first run.

A picture counts as right if the position lies on the subject and the range of disparities contains the median
of the subject. "sharp" is the fraction of the subject's pixels inside the range, widened by 2 % of the map's.
"others" is the fraction of all other pixels inside it.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.quality.scenes.subject_photographs import photograph_cases, shared_cases
from benchmarks.quality.scenes.subject_scenes import MAPS, Case, rendered_cases
from bokehnet.arrays.resample import resample
from bokehnet.io.image import write_image
from bokehnet.scene.subject import Subject, detect_faces, find_subject
from bokehnet.tools.contact_sheet import contact_sheet

Array = npt.NDArray[np.float32]

_TOLERANCE = 0.02


def score(case: Case, subject: Subject) -> tuple[bool, float, float]:
    """Return whether the subject is right, and the fractions of its own and of other pixels in the range."""
    if not case.subject.any():
        return subject.is_fallback, float("nan"), float("nan")
    column, row = subject.position
    margin = _TOLERANCE * float(np.ptp(case.disparity))
    median = float(np.median(case.disparity[case.subject]))
    in_range = (case.disparity >= subject.far - margin) & (case.disparity <= subject.near + margin)
    is_right = bool(case.subject[row, column]) and subject.far - margin <= median <= subject.near + margin
    others = float(in_range[~case.subject].mean())
    return is_right, float(in_range[case.subject].mean()), others


def _shown(case: Case, subject: Subject) -> Array:
    """Return the picture with everything outside the range darkened, and a cross at the position."""
    image = resample(case.image, *case.disparity.shape, "area")
    in_range = (case.disparity >= subject.far) & (case.disparity <= subject.near)
    shown = np.minimum(image, 1) * np.where(in_range, 1, 0.15)[..., None]
    column, row = subject.position
    arm = max(case.disparity.shape) // 30
    shown[row, max(column - arm, 0) : column + arm] = (1, 0, 0)
    shown[max(row - arm, 0) : row + arm, column] = (1, 0, 0)
    height, width = 150, 225
    scale = min(height / image.shape[0], width / image.shape[1])
    size = round(scale * image.shape[0]), round(scale * image.shape[1])
    framed = np.zeros((height, width, 3), np.float32)
    framed[: size[0], : size[1]] = resample(shown.astype(np.float32), *size, "area")
    return framed


def main(arguments: list[str] | None = None) -> None:
    """Print one line per picture, and the rate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sheet", type=Path, help="write a sheet of all pictures")
    parser.add_argument("--faces", action="store_true", help="detect faces")
    options = parser.parse_args(arguments)
    rendered = {f"rendered, {maps}": rendered_cases(maps) for maps in MAPS}
    groups = {**rendered, "photographs": photograph_cases(), "shared": shared_cases()}
    shown, rights = [], {}
    print(f"{'picture':30} {'right':6} {'sharp':>6} {'others':>7} {'certainty':>10}  choice")
    for group, cases in groups.items():
        rights[group] = []
        for case in cases:
            subject = find_subject(case.image, case.disparity, faces=detect_faces if options.faces else None)
            is_right, sharp, others = score(case, subject)
            rights[group].append(is_right)
            choice = (
                f"{subject.position[0]},{subject.position[1]}{' (fallback)' if subject.is_fallback else ''}"
            )
            print(
                f"{case.name:30} {'yes' if is_right else 'NO':6} {sharp:6.2f} {others:7.2f} "
                f"{subject.certainty:10.2f}  {choice}"
            )
            shown.append((f"{case.name}{'' if is_right else ': WRONG'}", _shown(case, subject)))
    for group, results in rights.items():
        print(f"{group}: {sum(results)} of {len(results)} right")
    total = [result for results in rights.values() for result in results]
    print(f"all: {sum(total)} of {len(total)} right")
    if options.sheet is not None:
        write_image(
            options.sheet, contact_sheet([shown[start : start + 5] for start in range(0, len(shown), 5)])
        )


if __name__ == "__main__":
    main()
