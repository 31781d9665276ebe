"""Spots in pictures: found where they are, nothing else taken for one, and given to the right laser."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.vision_scene import camera, shot
from urdfcal.base.errors import InputError, MeasurementError, UsageError
from urdfcal.base.tables import read_table
from urdfcal.vision.pictures import by_pose, image_files, picture_from, read_picture
from urdfcal.vision.render.image_sensor import ImageSensor
from urdfcal.vision.render.light import Beam, Lighting, backdrop, glare
from urdfcal.vision.spots.detector import PixelSpot, Sighting, find_spots
from urdfcal.vision.spots.labels import label_spots
from urdfcal.vision.spots.series import PoseSpots, put_together, without_still
from urdfcal.vision.spots.table import joined, sigma_on_screen, spots_csv

CLEAN, CLIPPED = Beam(brightness=0.9), Beam(brightness=8.0, halo=0.05)


def pixel_spot(u: float, v: float, colour: str = "red", sigma: float = 0.05) -> PixelSpot:
    return PixelSpot(colour, np.array([u, v]), np.eye(2) * sigma**2, 1.5, 1000.0, 0, 50.0)


def pose_of(label: str, *spots: PixelSpot) -> PoseSpots:
    return PoseSpots(label, spots, ())


@pytest.mark.parametrize("colour", ["red", "green"])
@pytest.mark.parametrize(("look", "px"), [(CLEAN, 0.1), (CLIPPED, 0.2)], ids=["clean", "clipped"])
def test_spots_are_found_to_a_fraction_of_a_pixel(colour: str, look: Beam, px: float, rng: np.random.Generator) -> None:
    """Two spots, unclipped or with a clipped core and halo, are found within a tenth or a fifth of a pixel and within their sigmas."""
    beam = Beam(colour, 1.2e-3, look.brightness, look.halo)
    pixels, truth = shot(camera(), [(101.3, 80.7), (297.8, 210.2)], [beam, beam], rng)
    found = find_spots(picture_from(pixels))
    assert [spot.colour for spot in found.spots] == [colour, colour]
    for centre in truth:
        off = min((spot.centre - centre for spot in found.spots), key=lambda away: float(np.linalg.norm(away)))
        spot = min(found.spots, key=lambda spot: float(np.linalg.norm(spot.centre - centre)))
        assert np.linalg.norm(off) < px, f"off by {np.linalg.norm(off):.3f} px"
        assert off @ np.linalg.solve(spot.covariance, off) < 18.0, f"off by {off} px, covariance {spot.covariance}"


def test_glare_alone_gives_no_spot(rng: np.random.Generator) -> None:
    """Lamps, glints, streaks and lens reflections of any tint are not spots."""
    view = camera()
    behind = backdrop(view, Lighting(0.2))
    found = [find_spots(picture_from(ImageSensor().expose(behind + glare(view.size, 8, rng), rng))).spots for _ in range(6)]
    assert [spots for spots in found if spots] == []


@pytest.mark.parametrize("colour", [(60, 60, 200), (0, 0, 0), (40, 160, 40), (255, 255, 255)], ids=["red", "black", "green", "white"])
def test_print_is_no_spot(colour: tuple[int, int, int], rng: np.random.Generator) -> None:
    """A printed dot on a light screen takes light away, whatever its colour; a white one is neutral."""
    pixels = np.full((200, 240, 3), 190, np.uint8)
    cv2.circle(pixels, (120 * 16 + 5, 90 * 16), 5 * 16, colour, -1, cv2.LINE_AA, 4)
    noisy = np.clip(cv2.GaussianBlur(pixels, (0, 0), 0.8) + rng.normal(0, 1.5, pixels.shape), 0, 255).astype(np.uint8)
    assert find_spots(picture_from(noisy)).spots == ()


def test_a_hot_pixel_and_a_cut_spot_are_refused_by_name(rng: np.random.Generator) -> None:
    """A single bright pixel, and a spot of which the edge of the picture cuts half away, are refused."""
    pixels, _ = shot(camera(), [(200.0, 0.2)], [CLEAN], rng)
    pixels[150, 60] = (10, 20, 250)
    found = find_spots(picture_from(pixels))
    assert found.spots == ()
    assert found.refused


def test_sigma_grows_with_clipping_and_slant(rng: np.random.Generator) -> None:
    """A clipped spot is less certain in pixels than the same spot unclipped, and an oblique view makes it less certain in mm."""
    dim, clipped = (
        find_spots(picture_from(shot(camera(), [(200.4, 150.3)], [Beam(width=1.5e-3, brightness=b)], rng)[0])).spots[0] for b in (0.9, 40)
    )
    assert clipped.clipped > 20
    assert np.trace(clipped.covariance) > np.trace(dim.covariance)
    steep, flat = (sigma_on_screen(camera(oblique_deg=degrees), pixel_spot(200, 150)) for degrees in (0.0, 50.0))
    assert flat > 1.2 * steep
    assert steep == pytest.approx(0.05 * 1.5e-3, rel=0.02)


def test_a_dark_picture_takes_lamps_away(rng: np.random.Generator) -> None:
    """With a picture taken with the lasers off, even a red lamp that looks like a spot is gone, and a grey camera is enough."""
    view = camera()
    on, truth = shot(view, [(150.0, 100.0), (260.4, 200.3)], [CLEAN, CLEAN], rng)
    off, _ = shot(view, [(150.0, 100.0)], [CLEAN], rng)
    assert len(find_spots(picture_from(on)).spots) == 2
    (spot,) = find_spots(picture_from(on).minus(picture_from(off))).spots
    assert np.linalg.norm(spot.centre - truth[1]) < 0.15
    with pytest.raises(InputError, match=r"is 400 x 300 px, the dark picture 200 x 300"):
        picture_from(on, "on.png").minus(picture_from(off[:, :200]))


def test_pictures_of_a_pose_are_averaged_and_their_scatter_counts() -> None:
    """The mean of several pictures has the scatter in its sigma; what is seen in half of them or fewer is refused."""
    offsets = [-0.5, 0.5, -0.5, 0.5, 0.0, 0.0]
    sightings = [Sighting((pixel_spot(100 + off, 50 - off),), ()) for off in offsets]
    sightings[0] = Sighting((*sightings[0].spots, pixel_spot(10, 10)), ())
    pose = put_together("p", sightings)
    (spot,) = pose.spots
    assert spot.centre == pytest.approx([100, 50])
    expected = (4 * 0.05**2 + 4 * 0.25) / 9 / 6
    assert np.diag(spot.covariance) == pytest.approx([expected, expected])
    assert [refused.reason for refused in pose.refused] == ["seen in 1 of 6 pictures of the pose"]


def test_what_stands_still_is_a_lamp() -> None:
    """A spot at one place in every pose is refused and named; those that move stay."""
    poses = [pose_of(str(k), pixel_spot(50 + 20 * k, 80), pixel_spot(300.2, 40.1)) for k in range(6)]
    cleaned, warnings = without_still(poses)
    assert [[round(spot.centre[0]) for spot in pose.spots] for pose in cleaned] == [[50 + 20 * k] for k in range(6)]
    assert warnings == ["a light at pixel (300, 40) stands still in 6 of 6 poses and was taken for no spot"]


def place(spot: PixelSpot) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.asarray(spot.centre)


def test_colours_tell_the_lasers_apart() -> None:
    """Of a red and a green laser each has its own colour's spot, alone or not; two spots of one colour are ambiguous and named."""
    poses = [
        pose_of("a", pixel_spot(10, 10, "green"), pixel_spot(90, 10, "red")),
        pose_of("b", pixel_spot(10, 10, "green")),
        pose_of("c", pixel_spot(10, 10, "red"), pixel_spot(90, 10, "red")),
    ]
    labelled = label_spots(poses, ("one", "two"), place, colours=("red", "green"))
    assert [{name: spot.centre[0] for name, spot in spots.items()} for spots in labelled.spots] == [{"one": 90, "two": 10}, {"two": 10}, {}]
    assert [warning.split(":")[0] for warning in labelled.warnings] == ["pose c"]


def test_left_and_right_where_nothing_else_tells() -> None:
    """Of two like lasers the first is left; one spot alone, and two above each other, are left empty and named."""
    poses = [
        pose_of("a", pixel_spot(90, 15), pixel_spot(10, 10)),
        pose_of("b", pixel_spot(10, 10)),
        pose_of("c", pixel_spot(50, 10), pixel_spot(52, 90)),
    ]
    labelled = label_spots(poses, ("one", "two"), place, colours=("red", "red"))
    assert [{name: spot.centre[0] for name, spot in spots.items()} for spots in labelled.spots] == [{"one": 10, "two": 90}, {}, {}]
    assert [warning.split(":")[0] for warning in labelled.warnings] == ["pose b", "pose c"]


def test_the_nominal_robot_tells_single_spots_apart(rng: np.random.Generator) -> None:
    """With predictions that are all off by an affine map, nearly every spot gets its own laser, and none another's."""
    predicted = rng.uniform(-500, 500, (40, 2, 2))
    seen = predicted @ np.array([[1.05, 0.1], [-0.1, 0.97]]) + [80.0, -120.0] + rng.normal(0, 3, predicted.shape)
    poses = []
    for pose in range(40):
        spots = [pixel_spot(*seen[pose, laser]) for laser in range(2) if pose < 30 or laser == pose % 2]
        poses.append(pose_of(str(pose), *spots[:: 1 if rng.random() < 0.5 else -1]))
    labelled = label_spots(poses, ("one", "two"), place, colours=("red", "red"), predicted=predicted)
    wrong = [
        pose
        for pose, spots in enumerate(labelled.spots)
        for laser, name in enumerate(("one", "two"))
        if name in spots and not np.allclose(spots[name].centre, seen[pose, laser])
    ]
    assert wrong == []
    assert sum(map(len, labelled.spots)) >= 62
    assert len(labelled.warnings) == sum(not spots for spots in labelled.spots)


def test_a_pose_without_a_spot_is_empty_and_says_nothing() -> None:
    """Where the nominal robot has spots and the picture none, or the other way round, the pose stays empty without a number's warning."""
    predicted = np.array([[[0.0, 0.0], [50.0, 0.0]], [[np.nan, np.nan]] * 2, [[10.0, 0.0], [60.0, 5.0]]])
    poses = [pose_of("a"), pose_of("b", pixel_spot(10, 10)), pose_of("c", pixel_spot(11, 1), pixel_spot(61, 4))]
    labelled = label_spots(poses, ("one", "two"), place, colours=("red", "red"), predicted=predicted)
    assert [set(spots) for spots in labelled.spots] == [set(), set(), {"one", "two"}]
    assert labelled.warnings == ["pose b: one spot, and the nominal beams make none; left empty"]


def test_pictures_are_put_together_by_pose(tmp_path: Path) -> None:
    """Folders, and names with numbers where two poses have them, are poses; img_001, img_002 are two poses; p10 comes after p2."""

    def groups(names: list[str], how: str = "auto", known: tuple[str, ...] = ()) -> dict[str, int]:
        found = by_pose([tmp_path / name for name in names], [tmp_path], how, known)  # type: ignore[arg-type]
        return {label: len(paths) for label, paths in found.items()}

    assert groups(["img_1.png", "img_2.png"]) == {"img_1": 1, "img_2": 1}
    assert groups(["img_1.png", "img_2.png"], "named") == {"img": 2}
    assert groups(["a_1.png", "a_2.png", "b_1.png", "b_2.png"]) == {"a": 2, "b": 2}
    assert groups(["a_1.png", "a_2.png", "b_1.png", "b_2.png"], known=("a_1", "a_2", "b_1", "b_2")) == {
        "a_1": 1,
        "a_2": 1,
        "b_1": 1,
        "b_2": 1,
    }
    assert groups(["home/1.png", "home/2.png", "far/1.png"]) == {"home": 2, "far": 1}
    with pytest.raises(UsageError, match="would both be pose 'a'"):
        groups(["a.png", "a.jpg"])
    for name in ("p10.png", "p2.png", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    assert [path.name for path in image_files([tmp_path])] == ["p2.png", "p10.png"]


def test_poses_are_joined_by_name_or_order(tmp_path: Path) -> None:
    """Rows are found by the column image or pose, by order only where neither is there and the numbers agree; else refused."""

    def rows(text: str, labels: tuple[str, ...] = ("b", "a")) -> list[int]:
        (tmp_path / "poses.csv").write_text(text)
        return joined({label: [tmp_path / f"{label}.png"] for label in labels}, read_table(tmp_path / "poses.csv", "columns", "rows"))[0]

    assert rows("image,q\na.png,1\nb.png,2\n") == [1, 0]
    assert rows("pose;q [deg]\na;1,5\nb;2\nc;3\n") == [1, 0]
    assert rows("q\n1\n2\n") == [0, 1]
    assert rows("image,pose\nIMG_1,a\nIMG_2,b\n") == [1, 0]
    assert rows("pose\nhome pose!\nhome-pose\n", ("home-pose", "home_pose")) == [1, 0]
    with pytest.raises(MeasurementError, match=r"column 'pose': no row\(s\) for the picture b.png, expected one; write a column 'image'"):
        rows("pose,q\nfirst,1\nsecond,2\n")
    with pytest.raises(MeasurementError, match=r"column 'pose': no row\(s\) for the picture b.png, expected one$"):
        rows("pose,q\na,1\nsecond,2\n")
    with pytest.raises(MeasurementError, match=r"poses.csv:2: column 'pose': 'my pose' names two pictures"):
        rows("pose,q\nmy pose,1\n", ("my pose", "my_pose"))
    with pytest.raises(MeasurementError, match=r"poses.csv:1: column 'image': no row\(s\) for the picture b.png"):
        rows("image,q\na.png,1\n")
    with pytest.raises(MeasurementError, match="has 3 rows for 2 poses"):
        rows("q\n1\n2\n3\n")


def test_spots_are_written_beside_the_columns_of_their_poses(tmp_path: Path) -> None:
    """Joint columns keep their units and get decimal points; a spot that was not seen is empty; names of pictures go."""
    (tmp_path / "poses.csv").write_text('pose;image;q [deg];set;laser_1.y\n"# 1";a;1,5;fit;0\n;b;-2;test;0\n')
    table = read_table(tmp_path / "poses.csv", "columns", "rows")
    spots = [{"laser_1": pixel_spot(12.5, 7.25)}, {}]
    content = spots_csv(["b", "a"], spots, ["laser_1"], pixels=True, table=table, rows=[1, 0], comments=["found"])
    assert content.decode().splitlines() == [
        "# found",
        "pose,q [deg],set,laser_1.u,laser_1.v,laser_1.sigma_px",
        "b,-2,test,12.5000,7.2500,0.0500",
        "1,1.5,fit,,,",
    ]


def test_sixteen_bits_and_broken_files(tmp_path: Path) -> None:
    """A picture of 16 bits has the light of its 8-bit copy; what is no picture is refused by name."""
    eight = np.random.default_rng(1).integers(0, 255, (20, 30, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), eight)
    cv2.imwrite(str(tmp_path / "b.png"), eight.astype(np.uint16) * 257)
    assert read_picture(tmp_path / "a.png").light == pytest.approx(read_picture(tmp_path / "b.png").light, abs=1e-3)
    (tmp_path / "c.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"c\.png: cannot be read as a picture"):
        read_picture(tmp_path / "c.png")
    with pytest.raises(InputError, match="is 30 x 20 px, expected the camera's 31 x 20"):
        read_picture(tmp_path / "a.png", (31, 20))
