import numpy as np

from photonormal.masked import grid_bands, made_smaller, means, numbered, on_map, picked, row_bands, taken


def test_bands_hold_every_pixel_once_and_few_of_them():
    mask = np.random.default_rng(0).random((40, 30)) > 0.6
    mask[:3] = mask[20:24] = False
    bands = row_bands(mask, 50)
    assert len(bands) > 5 and all(mask[b].sum() <= 50 for b in bands)
    assert sum(mask[b].sum() for b in bands) == mask.sum() and all(mask[b].any(1).all() for b in bands)
    assert row_bands(np.zeros((4, 4), bool)) == []
    assert [mask[rows].sum() for rows, _ in numbered(mask)] == [p.stop - p.start for _, p in numbered(mask)]


def test_of_a_grid_the_rows_between_are_skipped():
    mask = np.zeros((60, 8), bool)
    mask[4:50:3] = True
    assert grid_bands(mask) == [slice(4, 50, 3)]
    assert grid_bands(mask, 16) == [slice(k, k + 4, 3) for k in range(4, 50, 6)]
    mask[20:40] = False
    assert [mask[rows].sum() for rows in grid_bands(mask)] == [48, 32]
    mask[5] = True
    assert grid_bands(mask) == [slice(rows.start, rows.stop, 1) for rows in row_bands(mask)]
    far = np.zeros((60, 8), bool)
    far[[0, 40]] = True
    assert grid_bands(far) == [slice(0, 1, 1), slice(40, 41, 1)] and grid_bands(~far[:1]) == []


def test_what_is_taken_off_a_map_goes_back_to_its_place():
    random = np.random.default_rng(1)
    mask, map = random.random((2000, 900)) > 0.3, random.random((2000, 900, 3)).astype(np.float32)
    assert np.array_equal(taken(map, mask), map[mask])
    assert np.array_equal(on_map(taken(map, mask), mask), map * mask[..., None])
    assert np.isnan(on_map(taken(map[..., 0], mask), mask, np.nan)[~mask]).all()


def test_what_is_picked_is_what_a_mask_picks():
    random = np.random.default_rng(2)
    mask, map = random.random((30, 40)) > 0.3, random.random((30, 50, 3)).astype(np.float32)
    assert np.array_equal(picked(map[:, :40], mask), map[:, :40][mask])
    assert np.array_equal(picked(map[:, :40, 0], mask), map[:, :40, 0][mask])


def test_means_over_squares_count_what_is_left_over_at_the_edge_again():
    map = np.arange(35.0).reshape(5, 7)
    found = means(map, 2)
    assert found.shape == (3, 4) and means(map, 1) is map
    assert found[0, 0] == map[:2, :2].mean() and found[2, 0] == map[4, :2].mean() and found[2, 3] == map[4, 6]
    assert np.array_equal(means(np.stack([map, -map], -1), 2), np.stack([found, -found], -1))


def test_a_strip_made_smaller_keeps_a_row():
    for shape, smaller in (((6, 4000), (1, 40)), ((4000, 6, 3), (40, 1, 3)), ((600, 400), (6, 4))):
        found = made_smaller(np.full(shape, 0.5, np.float32), 0.01)
        assert found.shape == smaller and (found == 0.5).all()
