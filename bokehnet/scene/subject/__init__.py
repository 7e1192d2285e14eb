"""Subject of a picture, on which the automatic focus falls.

In: a picture and its map. Out: a :class:`Subject` with position, surface, range of disparities and certainty.
Open first: ``subject.py``.
"""

from bokehnet.scene.subject.faces import FaceDetector, detect_faces
from bokehnet.scene.subject.subject import Subject, find_subject, surface_around
from bokehnet.scene.subject.view import SubjectSearch

__all__ = ["FaceDetector", "Subject", "SubjectSearch", "detect_faces", "find_subject", "surface_around"]
