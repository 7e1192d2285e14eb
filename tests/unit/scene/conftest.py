from tests.unit.photo_folder import folder, photo, steps  # noqa: F401
