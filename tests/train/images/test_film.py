"""Pictures without colour, toned and faded ones."""

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("kornia")

import torch  # noqa: E402

from muybridge.train.images.camera_faults import CameraFaults  # noqa: E402
from muybridge.train.images.film import Film, develop, faded, grey, sample_films, toned  # noqa: E402


def _without_grain(film: Film) -> Film:
    return Film(film.mixture, film.contrast, film.pivot, film.gamma, film.black, film.white)


def test_grey_pictures_have_one_value_and_toned_ones_one_colour_for_each() -> None:
    rng, faults = np.random.default_rng(0), CameraFaults(np.random.default_rng(1))
    picture = rng.integers(0, 256, (40, 40, 3)).astype(np.uint8)
    for _ in range(20):
        plain = grey(rng).develop(picture, faults)
        assert (np.ptp(plain.astype(int), axis=2) == 0).all() and plain.std() > 3
        tinted = _without_grain(toned(rng)).develop(picture, faults).reshape(-1, 3).astype(int)
        order = np.argsort(tinted.sum(1))
        assert (np.diff(tinted[order], axis=0) >= -1).all()  # brighter in every channel, or in none
        assert np.ptp(tinted.mean(0)) > 1


def test_orthochromatic_film_is_blind_to_red() -> None:
    rng, faults = np.random.default_rng(0), CameraFaults(np.random.default_rng(1))
    red, blue = np.zeros((2, 8, 8, 3), np.uint8)
    red[..., 0], blue[..., 2] = 200, 200
    films = [_without_grain(grey(rng)) for _ in range(200)]
    blind = [film for film in films if film.mixture[0, 0] < 0.08 and film.mixture[0, 2] > 0.25]
    assert 20 < len(blind) < 80
    assert all(film.develop(blue, faults).mean() > film.develop(red, faults).mean() for film in blind)


@pytest.mark.parametrize("kind", [grey, toned, faded])
def test_slopes_tell_how_colours_differ(kind) -> None:
    rng, faults = np.random.default_rng(3), CameraFaults(np.random.default_rng(1))
    for _ in range(10):
        film = kind(rng)
        film = Film(film.mixture, film.contrast, 0.45, (1.0, 1.0, 1.0), film.black, film.white)
        low = np.full((4, 4, 3), 110, np.uint8)
        high = low + np.array([20, 6, 12], np.uint8)
        mean = film.develop(np.concatenate([low, high]), faults).astype(float)  # one picture: of one tone curve
        np.testing.assert_allclose(mean[-1, -1] - mean[0, 0], film.slopes @ [20, 6, 12], atol=2.5 * film.contrast + 1)


def test_films_are_drawn_by_their_shares_and_cost_nothing_without() -> None:
    rng = np.random.default_rng(0)
    films = sample_films(rng, 3000, (0.1, 0.0, 0.2))
    grey_ones = [i for i, film in films.items() if np.ptp(film.mixture, axis=0).max() == 0]
    assert 240 < len(grey_ones) < 360 and 780 < len(films) < 1020
    before = rng.bit_generator.state
    assert sample_films(rng, 9, (0.0, 0.0, 0.0)) == {} and rng.bit_generator.state == before
    pixels = torch.full((3, 3, 8, 8), 90, dtype=torch.uint8)
    develop(pixels, {1: Film(np.full((3, 3), 1 / 3), white=(0.5, 1.0, 1.0))}, CameraFaults(rng))
    assert (pixels[[0, 2]] == 90).all() and pixels[1, 0, 0, 0] == 45
