"""Scene around a single mesh: a camera, a lens and a lamp, for a preview of a file without a scene."""

from pathlib import Path

from bokehnet.scenes.tables import (
    CameraTable,
    EnvironmentTable,
    LampTable,
    LensTable,
    MaterialTable,
    MeshTable,
    SceneTable,
)

__all__ = ["mesh_scene"]

# Distance of the middle of the mesh and its longest side, m: it fills two thirds of the picture's height.
_DISTANCE_M, _SIZE_M = 1.5, 0.5


def mesh_scene(path: Path) -> SceneTable:
    """Return a scene of a mesh file, grey, of 0.5 m at 1.5 m, in the focus of a 50 mm lens at f/2.

    Args:
        path: OBJ, PLY, STL or glTF file with y up.
    """
    centre = (0.0, 0.0, _DISTANCE_M)
    grey = MaterialTable(color=(0.6, 0.6, 0.6))
    return SceneTable(
        camera=CameraTable(width=480, height=320),
        lens=LensTable(focal_length=50.0, f_number=2.0, focus_distance=_DISTANCE_M),
        environment=EnvironmentTable(color=(0.35, 0.37, 0.4)),
        meshes=(MeshTable(file=str(path.resolve()), material=grey, size=_SIZE_M, centre=centre),),
        lamps=(LampTable(position=(-1.0, -1.2, 0.3), intensity=(7.0, 6.6, 6.0)),),
    )
