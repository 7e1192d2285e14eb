import numpy as np
import pytest

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.unmixing import MIN_FILTER_WEIGHT, PRIOR, unmix
from bokehnet.classical.layered.depth_discontinuities import discontinuity_sides
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, parse_pixel_filter

FILTERS = ["blackman-harris", "box", "gaussian", "gaussian:3.6", "mitchell"]
NOTHING_SPARED = np.zeros((20, 24), bool)


def seen(labels, pixel_filter=DEFAULT_FILTER):
    """Return the filtered labels (H, W), over the squares of neighbours with their weights, (H, W)."""
    weights = np.maximum(pixel_filter.weights(), MIN_FILTER_WEIGHT)
    weights /= weights.sum()
    reach = len(weights) // 2
    height, width = labels.shape
    label = np.pad(labels.astype(float), reach, "edge")
    return sum(
        weights[i] * weights[j] * label[i : i + height, j : j + width]
        for i in range(len(weights))
        for j in range(len(weights))
    )


def scene(seed=0, least=0.0, pixel_filter=DEFAULT_FILTER, texture=0.1):
    """A slanted edge between two textured surfaces, seen through the pixel filter; 20x24 pixels."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:20, :24]
    front = columns + 0.3 * rows < 14
    near = np.array([0.7, 0.2, 0.1]) + texture * rng.random((20, 24, 3)) + least
    far = np.array([0.1, 0.3, 0.9]) + texture * rng.random((20, 24, 3)) + least
    share = seen(front, pixel_filter)
    image = share[..., None] * near + (1 - share[..., None]) * far
    return image.astype(np.float32), np.where(front, 6.0, -9.0).astype(np.float32), share, near, far


def literal(image, defocus, sides, pixel_filter):
    """The docstring's problems, round after round, each by dense linear algebra: share, front, back."""
    depths = (defocus.max(), defocus.min())
    image = image.astype(float)
    shares = seen(defocus == depths[0], pixel_filter)

    def moments(weighted):
        total = sum(weight for weight, _ in weighted)
        mean = sum(weight * color for weight, color in weighted) / total
        square = sum(weight * (color @ color) for weight, color in weighted) / total
        return mean, max((square - mean @ mean) / 3, 0)

    def around(y, x, reach, square):
        for v in range(max(0, y - reach), min(20, y + reach + 1)):
            for u in range(max(0, x - reach), min(24, x + reach + 1)):
                yield v, u, np.exp(-((v - y) ** 2 + (u - x) ** 2) / square)

    def first_look(y, x, side):
        window = around(y, x, PRIOR.window_px, PRIOR.window_variance)
        there = [(v, u, w) for v, u, w in window if defocus[v, u] == depths[side]]
        return moments([(w * (PRIOR.mixed_weight if sides[v, u] else 1), image[v, u]) for v, u, w in there])

    def look_again(y, x, side, unmixed):
        weighted = []
        for v, u, w in around(y, x, 1, PRIOR.neighbour_variance):
            if (v, u) in unmixed:
                share, *colors = unmixed[v, u]
                share = share if side == 0 else 1 - share
                weighted.append((w * (share**2 + PRIOR.min_weight), colors[side]))
            elif defocus[v, u] == depths[side]:
                weighted.append((w, image[v, u]))
        return moments(weighted)

    def most_variances(y, x):
        near_by = [
            (v, u) for v, u, _ in around(y, x, PRIOR.window_px, PRIOR.window_variance) if not sides[v, u]
        ]
        pure = [[image[p] for p in near_by if defocus[p] == depth] for depth in depths]
        if min(map(len, pure)) < PRIOR.min_pure_pixels:
            return np.inf, np.inf
        return [PRIOR.max_variance_ratio * np.var(colors, axis=0).mean() for colors in pure]

    def place_edges(unmixed):
        slopes = np.maximum(4 * shares * (1 - shares), PRIOR.min_edge_slope)
        placed = shares.copy()
        for y, x in unmixed:
            rows, said, weights = [], [], []
            for v, u, w in around(y, x, PRIOR.edge_window_px, PRIOR.edge_window_variance):
                if (v, u) in unmixed:
                    share, front, back = unmixed[v, u]
                    apart = (front - back) @ (front - back)
                    rows.append(slopes[v, u])
                    said.append(share - shares[v, u])
                    weights.append(w * apart / (apart + PRIOR.edge_contrast))
            root = np.sqrt([*weights, PRIOR.edge_prior_weight])
            shift = np.linalg.lstsq(root[:, None] * [[r] for r in (*rows, 1)], root * (*said, 0))[0][0]
            placed[y, x] = min(max(shares[y, x] + slopes[y, x] * shift, 0.0), 1.0)
        return placed

    def part(y, x, front, front_variance, back, back_variance):
        least = PRIOR.min_sigma**2 + PRIOR.min_relative_sigma**2 * (front @ front + back @ back) / 3
        share, most = float(shares[y, x]), most_variances(y, x)
        front_variance, back_variance = min(front_variance, most[0]), min(back_variance, most[1])
        prior = np.diag([spread**2] + 3 * [front_variance + least] + 3 * [back_variance + least])
        row = np.hstack([(front - back)[:, None], share * np.eye(3), (1 - share) * np.eye(3)])
        error = image[y, x] - share * front - (1 - share) * back
        moved = prior @ row.T @ np.linalg.solve(row @ prior @ row.T, error)
        share, front, back = min(max(share + moved[0], 0.0), 1.0), front + moved[1:4], back + moved[4:]
        error = image[y, x] - share * front - (1 - share) * back  # of second order
        weights = np.array([share * prior[1, 1], (1 - share) * prior[4, 4]])
        weights /= share * weights[0] + (1 - share) * weights[1]
        return share, front + weights[0] * error, back + weights[1] * error

    places = [(int(y), int(x)) for y, x in np.argwhere(sides)]
    spread = PRIOR.coverage_sigma
    unmixed = {place: part(*place, *first_look(*place, 0), *first_look(*place, 1)) for place in places}
    for number in range(PRIOR.iterations + PRIOR.located_iterations):
        if number == PRIOR.iterations:
            shares, spread = place_edges(unmixed), PRIOR.located_sigma
        results = {p: (*look_again(*p, 0, unmixed), *look_again(*p, 1, unmixed)) for p in places}
        unmixed = {place: part(*place, *means) for place, means in results.items()}
    return unmixed


@pytest.mark.parametrize("texture", [0.1, 0.001])
@pytest.mark.parametrize("name", FILTERS)
def test_pixels_are_unmixed_as_the_least_squares_say(name, texture):
    """Oracle: the same problems with dense matrices; so bright that no light is below 0."""
    pixel_filter = parse_pixel_filter(name)
    image, defocus, *_ = scene(least=0.6, pixel_filter=pixel_filter, texture=texture)
    sides = discontinuity_sides(defocus, len(pixel_filter.weights()) // 2)
    unmixed = unmix(image, defocus, sides, NOTHING_SPARED, pixel_filter)
    assert len(unmixed.rows) == np.count_nonzero(sides) > 30
    expected = literal(image, defocus, sides, pixel_filter)
    for i, place in enumerate(zip(unmixed.rows, unmixed.columns, strict=True)):
        share, front, back = expected[place]
        assert min(front.min(), back.min()) > 0
        assert unmixed.coverage[i] == pytest.approx(share, abs=1e-5)
        np.testing.assert_allclose(unmixed.front[i], front, atol=1e-5)
        np.testing.assert_allclose(unmixed.back[i], back, atol=1e-5)


@pytest.mark.parametrize("lowest", [0.0, -0.2])
def test_both_surfaces_add_up_to_the_picture(lowest):
    image = np.random.default_rng(1).uniform(lowest, 1, (20, 24, 3)).astype(np.float32)
    defocus = scene()[1]
    unmixed = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)
    share = unmixed.coverage[:, None]
    added = share * unmixed.front + (1 - share) * unmixed.back
    np.testing.assert_allclose(added, image[unmixed.rows, unmixed.columns], atol=1e-5)
    if lowest == 0.0:
        assert min(unmixed.front.min(), unmixed.back.min()) >= 0


def test_colours_are_purer_than_the_picture():
    """Truth: the surfaces that the picture was mixed of."""
    image, defocus, share, near, far = scene()
    unmixed = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)
    own = np.where(unmixed.is_front[:, None], unmixed.front, unmixed.back)
    y, x = unmixed.rows, unmixed.columns
    truth = np.where(unmixed.is_front[:, None], near[y, x], far[y, x])
    assert np.abs(own - truth).mean() < 0.5 * np.abs(image[y, x] - truth).mean()
    assert np.abs(unmixed.coverage - share[y, x]).mean() < 0.03


def test_a_light_is_spared_and_colours_nothing():
    image, defocus, *_ = scene()
    plain = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)
    lit, spared = image.copy(), NOTHING_SPARED.copy()
    lit[10, 10], spared[10, 10] = 100.0, True
    unmixed = unmix(lit, defocus, discontinuity_sides(defocus), spared)
    assert not ((unmixed.rows == 10) & (unmixed.columns == 10)).any()
    assert unmixed.front.max() < plain.front.max() + 0.1


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
def test_small_pictures(shape):
    rng = np.random.default_rng(2)
    image = rng.random((*shape, 3), dtype=np.float32)
    defocus = rng.uniform(-9, 9, shape).astype(np.float32)
    unmixed = unmix(image, defocus, discontinuity_sides(defocus), np.zeros(shape, bool))
    for array in (unmixed.front, unmixed.back, unmixed.coverage):
        assert np.isfinite(array).all()
    assert (unmixed.near >= unmixed.far).all()


def test_a_held_coverage_stays_and_both_surfaces_add_up():
    image, defocus, share, near, far = scene()
    y, x = np.nonzero((share > 0) & (share < 1))
    held = KnownSurfaces(
        rows=y,
        columns=x,
        near=np.full(len(y), 6.0),
        far=np.full(len(y), -9.0),
        coverage=share[y, x],
    )
    unmixed = unmix(image, defocus, np.zeros((20, 24), np.int8), NOTHING_SPARED, known=held)
    np.testing.assert_array_equal(np.stack([unmixed.rows, unmixed.columns]), np.stack([y, x]))
    np.testing.assert_allclose(unmixed.coverage, share[y, x], atol=1e-6)
    assert (unmixed.near == 6).all()
    weight = unmixed.coverage[:, None]
    np.testing.assert_allclose(weight * unmixed.front + (1 - weight) * unmixed.back, image[y, x], atol=1e-5)
    estimated = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)

    def error(result):
        own = np.where(result.is_front[:, None], result.front, result.back)
        truth = np.where(
            result.is_front[:, None], near[result.rows, result.columns], far[result.rows, result.columns]
        )
        return np.abs(own - truth).mean()

    assert error(unmixed) < 1.1 * error(estimated)


def test_a_surface_that_is_all_light_is_known_by_its_lights():
    """A white frame before the night, all of it a light; its outline is not bright enough to be one."""
    front = np.zeros((20, 24), bool)
    front[8:12] = True
    share = np.where(front, 1.0, 0.0)
    share[7] = 0.35
    image = (share[..., None] * 0.5 + (1 - share[..., None]) * 0.007).repeat(3, axis=-1).astype(np.float32)
    defocus = np.where(front, 9.0, 0.0).astype(np.float32)
    unmixed = unmix(image, defocus, discontinuity_sides(defocus), front)
    outline = unmixed.rows == 7
    assert outline.sum() == 24
    np.testing.assert_allclose(unmixed.front[outline], 0.5, rtol=0.05)
    np.testing.assert_allclose(unmixed.coverage[outline], 0.35, atol=0.05)


def test_a_light_is_spared_though_its_coverage_is_held():
    image, defocus, *_ = scene()
    spared = NOTHING_SPARED.copy()
    spared[10, 10] = True
    held = KnownSurfaces(
        rows=np.array([10, 10]),
        columns=np.array([10, 11]),
        near=np.full(2, 6.0),
        far=np.full(2, -9.0),
        coverage=np.array([0.3, 0.4]),
    )
    unmixed = unmix(image, defocus, np.zeros((20, 24), np.int8), spared, known=held)
    assert unmixed.columns.tolist() == [11]
    assert unmixed.coverage[0] == np.float32(0.4)


def test_even_surfaces_stay_even_though_the_filter_is_not_quite_known():
    """Truth: a bright frame before an even wall, 0.43 of a pixel at its outline; the filter says less."""
    share = np.zeros((20, 24))
    share[8:], share[7] = 1.0, 0.43
    image = (share[..., None] * 0.5 + (1 - share[..., None]) * 0.009).repeat(3, axis=-1).astype(np.float32)
    defocus = np.where(share > 0.5, 9.0, 0.0).astype(np.float32)
    narrow = parse_pixel_filter("gaussian:1.39")
    unmixed = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED, narrow)
    inside = (unmixed.columns > 3) & (unmixed.columns < 20)  # at the border too few pixels are seen
    np.testing.assert_allclose(unmixed.front[inside], 0.5, atol=0.02)
    np.testing.assert_allclose(unmixed.back[inside], 0.009, atol=0.01)
    np.testing.assert_allclose(
        unmixed.coverage[inside], share[unmixed.rows, unmixed.columns][inside], atol=0.02
    )
