"""cameras.json as people write it who have not read ours."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occ_recon_ros.bags.dataset import load_dataset
from occ_recon_ros.errors import UserError


def each(change):
    def write(content):
        for entry in content["frames"]:
            change(entry)
        return content

    return write


def flat(entry):
    entry["K"], entry["R"] = np.ravel(entry["K"]).tolist(), np.ravel(entry["R"]).tolist()


def vectors(entry):
    entry["rvec"] = Rotation.from_matrix(entry.pop("R")).as_rotvec()[:, None].tolist()
    entry["tvec"] = np.reshape(entry.pop("t"), (3, 1)).tolist()


def without_size(entry):
    del entry["width"], entry["height"]


def under_another_name(entry):
    entry["file_path"] = entry.pop("file")


def lens_of_all(content):
    for key in ("K", "D", "width", "height"):
        for entry in content["frames"]:
            content[key] = entry.pop(key)
    return content


def in_metres(content):
    for entry in content["frames"]:
        entry["t"] = (0.001 * np.array(entry["t"])).tolist()
    return content["frames"]


@pytest.mark.parametrize(
    "write",
    [
        each(flat),
        each(vectors),
        each(without_size),
        each(under_another_name),
        lens_of_all,
        in_metres,
        each(lambda e: e.update(R=Rotation.from_matrix(e["R"]).as_rotvec().tolist())),
    ],
)
def test_what_is_plain_is_taken_as_it_is_meant(folder, write):
    wanted, *_ = load_dataset(folder.path)
    (folder.path / "cameras.json").write_text(json.dumps(write(folder.content)))
    found, left_out, _ = load_dataset(folder.path)
    assert not left_out
    for frame, as_ours in zip(found, wanted, strict=True):
        assert (frame.image, frame.mask) == (as_ours.image, as_ours.mask)
        for name in ("K", "D", "width", "height", "R_camera_object", "t_camera_object"):
            np.testing.assert_allclose(
                getattr(frame.camera, name), getattr(as_ours.camera, name), atol=1e-12
            )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"K": [[1.4, 0, 0.5], [0, 1.9, 0.5], [0, 0, 1]]}, "K must be in pixels: its focal length"),
        ({"K": [[80.0, 0, 0], [0, 80, 0], [0, 0, 1]]}, "K has its principal point at 0, 0"),
        ({"R": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "its rotation mirrors"),
        ({"R": np.diag([1, 2, 1]).tolist()}, "R is not a rotation matrix"),
        ({"R": [0, 90, 0]}, "must be a rotation vector"),
    ],
)
def test_what_is_not_is_said_in_words(folder, change, words):
    each(lambda entry: entry.update(change))(folder.content)
    folder.save()
    with pytest.raises(UserError, match=words) as error:
        load_dataset(folder.path)
    assert "camera_object" not in str(error.value)


def test_a_frame_that_is_listed_twice_is_taken_once(folder):
    copy = folder.content["frames"][1] | {"file": "copy of 1.jpg"}
    (folder.path / copy["file"]).write_bytes(folder.image(1).read_bytes())
    folder.content["frames"] += [folder.content["frames"][0], copy]
    folder.save()
    frames, left_out, remarks = load_dataset(folder.path)
    assert [frame.image.name for frame in frames] == ["0.png", "1.jpg", "2.png"]
    assert not left_out
    assert any(said.startswith("2 frames show a photograph that an earlier") for said in remarks)
