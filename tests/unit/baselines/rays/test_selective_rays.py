import numpy as np
import pytest

from bokehnet.baselines.gather.scatter_as_you_gather import tan
from bokehnet.baselines.rays.ray_mask import in_mixed_tiles, normals_of_depth, ray_mask, sobel_magnitude
from bokehnet.baselines.rays.reprojection import History
from bokehnet.baselines.rays.selective_rays import RaySelection, checked_trace, lens_rays, selective_rays
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.lenses import ThinLens
from bokehnet.optics.pixels.sample_allocation import neyman

WIDTH, HEIGHT, PITCH = 48, 32, 0.5
NEAR, FAR = 1000.0, 3000.0
LENS = ThinLens(focal_length=50.0, f_number=0.5, focus_distance=FAR)


def trace_rays(origins, directions):
    """A dark card at 1 m on the left of the axis, before a striped wall at 3 m."""
    at_card = origins[:, 0] + NEAR * directions[:, 0]
    at_wall = origins[:, 0] + FAR * directions[:, 0]
    card = at_card < 0
    wall = 0.5 + 0.4 * np.sin(at_wall / 120.0)
    color = np.where(card[:, None], [0.1, 0.2, 0.3], wall[:, None])
    return color, np.where(card, NEAR, FAR), np.ones(len(origins), bool)


def pinhole():
    """Picture, depth and normals through the middle of the lens."""
    slope = (np.arange(WIDTH) + 0.5 - WIDTH / 2) * PITCH / LENS.sensor_distance
    directions = np.stack([slope, np.zeros(WIDTH), np.ones(WIDTH)], -1)
    color, depth, _ = trace_rays(np.zeros((WIDTH, 3)), directions)
    normals = np.zeros((HEIGHT, WIDTH, 3))
    normals[..., 2] = -1
    return np.tile(color, (HEIGHT, 1, 1)), np.tile(depth, (HEIGHT, 1)), normals


def truth(count=512):
    """Distributed rays of Cook's, all of them."""
    rng, total = np.random.default_rng(9), np.zeros((HEIGHT * WIDTH, 3))
    for _ in range(count):
        total += trace_rays(*lens_rays(LENS, (HEIGHT, WIDTH), PITCH, np.arange(HEIGHT * WIDTH), rng))[0]
    return (total / count).reshape(HEIGHT, WIDTH, 3)


def rms(first, second):
    return float(np.sqrt(((first - second) ** 2).mean()))


def test_rays_bring_what_the_post_process_cannot_see():
    """Authority: a distribution tracer of the same callback."""
    image, depth, normals = pinhole()
    exact = truth()
    results = {
        (mask, rule): selective_rays(
            image, depth, normals, trace_rays, LENS, PITCH, RaySelection(mask=mask, rule=rule)
        )
        for mask, rule in (("sobel-depth", "tan"), ("reach", "tan"), ("reach", "ours"))
    }
    near = results["reach", "ours"].rays > 0
    post = rms(results["reach", "ours"].post_process[near], exact[near])
    published, masked, own = (rms(result.bokeh[near], exact[near]) for result in results.values())
    assert max(own, masked) < published
    assert own < 0.5 * post
    ratio = results["reach", "ours"].hit_ratio[HEIGHT // 2]
    assert ratio[WIDTH // 2 - 3] > 0.8 > 0.2 > ratio[WIDTH // 2 + 2]  # either side of the card's edge


def test_parallel_cards_are_no_edge_to_their_normals():
    image, depth, normals = pinhole()
    blind = selective_rays(image, depth, normals, trace_rays, LENS, PITCH)
    assert blind.rays.max() == 0
    assert (
        selective_rays(image, depth, normals, trace_rays, LENS, PITCH, RaySelection(mask="reach")).rays.max()
        > 0
    )


def test_sobel_gives_the_slope_of_a_ramp():
    """Authority: the derivative."""
    ramp = 3.0 * np.arange(20)[None] + 4.0 * np.arange(16)[:, None]
    np.testing.assert_allclose(sobel_magnitude(ramp)[3:-3, 3:-3], 5.0)


def test_a_flat_floor_is_all_edge_by_its_depth():
    """The thesis dropped the depth, because on a floor h below, z = h / slope rises with the square of z."""
    rows = np.arange(1, 65)[:, None] / 64.0
    depth = np.broadcast_to(1000.0 / rows, (64, 40))[::-1].copy()
    defocus = np.zeros((64, 40), np.float32)
    normals = np.zeros((64, 40, 3))
    normals[..., 1] = -1
    by_depth = ray_mask("sobel-depth", normals, depth, defocus, 10.0)
    assert by_depth[-4, 20] > 0.9 > 0.5 > by_depth[6, 20]
    assert ray_mask("sobel", normals, depth, defocus, 10.0).max() == pytest.approx(0)
    assert ray_mask("reach", normals, depth, defocus).max() == 0


def test_normals_of_a_slanted_plane():
    """Authority: z = c / (1 - x m) has the normal (-m, 0, 1) up to length and sign."""
    slope = (np.arange(30) - 14.5) * 0.02
    depth = np.tile(1000 / (1 - 0.5 * slope), (20, 1))
    expected = np.array([-0.5, 0, 1]) / np.sqrt(1.25)
    result = normals_of_depth(depth, 0.02)[5:-5, 5:-5]
    np.testing.assert_allclose(np.abs(result @ expected), 1, atol=1e-3)
    assert (result[..., 2] < 0).all()


def test_a_budget_is_kept_and_seeds_repeat():
    image, depth, normals = pinhole()
    results = [
        selective_rays(
            image, depth, normals, trace_rays, LENS, PITCH, RaySelection(mask="reach", budget=6.0, seed=seed)
        )
        for seed in (1, 1, 2)
    ]
    assert results[0].rays.mean() <= 6.1
    np.testing.assert_array_equal(results[0].bokeh, results[1].bokeh)
    assert (results[0].bokeh != results[2].bokeh).any()


def answers(color=np.ones((4, 3)), depth=np.ones(4), hit=np.ones(4)):  # noqa: B008
    """A callback that says the same to all rays."""
    return lambda origins, directions: (color, depth, hit)


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (
            lambda o, d: (np.full((len(o), 3), np.nan), np.ones(len(o)), np.ones(len(o))),
            ParameterError,
            "4 rays",
        ),
        (answers(depth=np.zeros(4)), ParameterError, "4 rays"),
        (
            lambda o, d: (np.ones((2, 3)), np.ones(len(o)), np.ones(len(o))),
            ShapeError,
            r"colour of shape \(4, 3\)",
        ),
        (lambda o, d: np.ones((len(o), 3)), ParameterError, "got a ndarray"),
        (lambda o, d: 1 / 0, ParameterError, "ZeroDivisionError: division by zero"),
    ],
)
def test_a_wrong_callback_is_one_line(answer, error, message):
    with pytest.raises(error, match=f"trace_rays: .*{message}") as caught:
        checked_trace(answer, np.zeros((4, 3)), np.ones((4, 3)))
    assert "\n" not in str(caught.value)
    misses = checked_trace(
        lambda o, d: (o, np.zeros(len(o)), np.zeros(len(o))), np.zeros((4, 3)), np.ones((4, 3))
    )
    assert np.isinf(misses[1]).all()


def test_wrong_numbers_are_refused():
    image, depth, normals = pinhole()
    for options, name in (
        ({"mask": "edges"}, "mask"),
        ({"rule": "his"}, "rule"),
        ({"max_rays": 0}, "max_rays"),
    ):
        with pytest.raises(ParameterError, match=name):
            selective_rays(image, depth, normals, trace_rays, LENS, PITCH, RaySelection(**options))
    with pytest.raises(ShapeError, match="depth"):
        selective_rays(image, depth[1:], normals, trace_rays, LENS, PITCH)


def test_rays_of_the_last_frame_follow_their_surfaces():
    """Oracle: pixel by pixel; what stood at another depth, or outside, brings nothing."""
    rng = np.random.default_rng(3)
    depth = np.where(rng.random((5, 7)) < 0.5, 1000.0, 3000.0)
    old = History(
        light=rng.random((2, 35, 3)),
        count=rng.integers(0, 60, (2, 35)).astype(float),
        first=rng.random(35),
        second=rng.random(35),
        depth=depth,
    )
    motion = np.zeros((5, 7, 2))
    motion[..., 0] = 1.6  # two pixels to the right of where they are now
    now = np.where(rng.random((5, 7)) < 0.8, np.roll(depth, -2, 1), 500.0)
    result = old.moved(motion, now)
    for y in range(5):
        for x in range(7):
            selected = x + 2 < 7 and depth[y, min(x + 2, 6)] == now[y, x]
            before, here = 7 * y + min(x + 2, 6), 7 * y + x
            share = selected * min(1, 64 / max(old.count[:, before].sum(), 1))
            assert np.allclose(result.light[:, here], share * old.light[:, before])
            assert np.allclose(result.count[:, here], share * old.count[:, before])
            assert result.first[here] == pytest.approx(share * old.first[before])
    assert result.count.sum(0).max() <= 64 + 1e-9
    with pytest.raises(ShapeError, match="motion"):
        old.moved(motion[..., 0], now)


def test_a_frame_with_its_past_is_less_noisy_and_sends_no_more_rays():
    image, depth, normals = pinhole()
    exact, still = truth(), np.zeros((HEIGHT, WIDTH, 2))
    options = {"mask": "reach", "rule": "ours", "frames": 1}
    first = selective_rays(image, depth, normals, trace_rays, LENS, PITCH, RaySelection(**options))
    past, alone = (
        selective_rays(
            image, depth, normals, trace_rays, LENS, PITCH, RaySelection(seed=1, history=history, **options)
        )
        for history in (first.history.moved(still, depth), None)
    )
    near = first.rays > 0
    assert past.rays.sum() == alone.rays.sum() == first.rays.sum()
    assert rms(past.bokeh[near], exact[near]) < 0.85 * rms(alone.bokeh[near], exact[near])


def test_rays_go_where_noise_shows_and_no_budget_is_passed():
    image, depth, normals = pinhole()
    exact = truth()
    even, spread = (
        selective_rays(
            image,
            depth,
            normals,
            trace_rays,
            LENS,
            PITCH,
            RaySelection(mask="reach", rule="ours", max_rays=8, frames=6, budget=6, allocation=allocation),
        )
        for allocation in (None, neyman)
    )
    assert spread.rays.mean() <= 6.1
    assert spread.rays.max() <= 8 * 6
    near = spread.rays > 0
    assert rms(spread.bokeh[near], exact[near]) < 1.05 * rms(even.bokeh[near], exact[near])


def test_tiles_of_one_depth_send_no_rays_and_take_the_cheap_way():
    """Far from a step, normals that turn are an edge to the published mask, but hide nothing."""
    defocus = np.full((96, 160), 4.0, np.float32)
    defocus[:, :16] = -6
    mixed = in_mixed_tiles(defocus)
    assert mixed[:, :32].all()
    assert not mixed[:, 64:].any()
    assert not in_mixed_tiles(np.zeros((40, 40), np.float32)).any()
    image, depth, normals = pinhole()
    wide = np.tile(image, (1, 4, 1))
    depth, normals = np.full(wide.shape[:2], FAR / 2), np.tile(normals, (1, 4, 1))
    normals[:, 60:] = [1, 0, 0]
    whole, cheap = (
        selective_rays(wide, depth, normals, trace_rays, LENS, PITCH, RaySelection(by_tile=way))
        for way in (False, True)
    )
    assert whole.rays.max() > 0
    assert cheap.rays.max() == 0
    assert np.array_equal(cheap.bokeh, tan(wide, whole_defocus(depth), by_tile=True))


def whole_defocus(depth):
    return (LENS.coc_radius(1 / depth) / PITCH).astype(np.float32)


def test_a_custom_mask_selects_the_pixels_that_send_rays():
    image, depth, normals = pinhole()
    share = np.zeros(depth.shape)
    share[:, WIDTH // 2 - 4 : WIDTH // 2 + 4] = 1
    sent = selective_rays(image, depth, normals, trace_rays, LENS, PITCH, RaySelection(mask=share)).rays
    assert np.array_equal(sent > 0, share > 0)
    with pytest.raises(ParameterError, match=r"^mask: expected fractions from 0 to 1"):
        selective_rays(image, depth, normals, trace_rays, LENS, PITCH, RaySelection(mask=2 * share))
    with pytest.raises(ShapeError, match="mask"):
        selective_rays(image, depth, normals, trace_rays, LENS, PITCH, RaySelection(mask=share[1:]))
