"""Notebook widget that focuses a picture at a click. Requires anywidget: pip install 'bokehnet[notebook]'."""

from typing import Any

from bokehnet.checks import require_extra
from bokehnet.errors import BokehnetError
from bokehnet.render.notebook import picture_url
from bokehnet.render.renderer import BokehRenderer
from bokehnet.render.result import RenderResult
from bokehnet.scene.scene import Scene
from bokehnet.settings.settings import RenderSettings, merged

require_extra("anywidget", "notebook")

import anywidget  # noqa: E402
import traitlets  # noqa: E402

__all__ = ["FocusWidget"]

_SCRIPT = """
function render({ model, el }) {
  const picture = document.createElement("img");
  const line = document.createElement("div");
  picture.style.cssText = "max-width: 100%; cursor: crosshair";
  picture.alt = "click to focus";
  const show = () => { picture.src = model.get("picture"); line.textContent = model.get("line"); };
  picture.addEventListener("click", (event) => {
    const box = picture.getBoundingClientRect();
    const u = (event.clientX - box.left) / box.width, v = (event.clientY - box.top) / box.height;
    line.textContent = "rendering";
    model.set("clicked", [u, v]);
    model.save_changes();
  });
  model.on("change:picture", show);
  model.on("change:line", show);
  show();
  el.append(picture, line);
}
export default { render };
"""


class FocusWidget(anywidget.AnyWidget):
    """A scene that is rendered again at each click, focused at the clicked point.

    Args:
        scene: Scene to render.
        settings: All other settings; default: a blur of a fortieth of the picture's width.
        renderer: Renderer; default: engine "scatter", the fastest.

    Attributes:
        clicked: Clicked position as fractions of width and height from the upper left; programs may set it.
        line: Status line below the picture.
        picture: Displayed picture, as a ``data:`` address.
        result: Last result; None before the first click.

    Examples:
        >>> from bokehnet.tools.demo import small_demo_scene
        >>> widget = FocusWidget(small_demo_scene())
        >>> widget.clicked = [0.5, 0.5]
        >>> widget.line
        'focus at pixel 72,48'
    """

    _esm = _SCRIPT
    picture = traitlets.Unicode("").tag(sync=True)
    line = traitlets.Unicode("").tag(sync=True)
    clicked = traitlets.List(traitlets.Float(), default_value=[], maxlen=2).tag(sync=True)

    def __init__(
        self, scene: Scene, settings: RenderSettings | None = None, renderer: BokehRenderer | None = None
    ) -> None:
        super().__init__()
        width = scene.image.shape[1]
        self._scene, self._renderer = scene, renderer or BokehRenderer("scatter")
        self._settings = settings or RenderSettings().updated({"camera": {"blur": width / 40}})
        self.result: RenderResult | None = None
        self.line = "click to focus"
        self.picture = picture_url(scene.image)

    @traitlets.observe("clicked")
    def _focus(self, change: Any) -> None:
        height, width = self._scene.image.shape[:2]
        u, v = change["new"]
        pixel = (min(max(int(u * width), 0), width - 1), min(max(int(v * height), 0), height - 1))
        try:
            table = merged(self._settings.to_table(), {"focus": {"at": pixel}})
            self.result = self._renderer.render(self._scene, RenderSettings().updated(table))
        except BokehnetError as error:
            self.line = str(error)
            return
        self.picture = picture_url(self.result.bokeh)
        self.line = f"focus at pixel {pixel[0]},{pixel[1]}"
