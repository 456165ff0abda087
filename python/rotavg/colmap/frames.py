"""What a pose graph and a reconstruction of COLMAP's say together: frames, sensors, components."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import GraphError
from rotavg.graph.conventions import convert_family
from rotavg.graph.ids import IdArray

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Frames:
    """Images of a pose graph by their ids, and the rigs they belong to.

    Attributes:
        frame_of: the frame of an image.
        sensor_of: its sensor: the id of its camera.
        rig_of: the rig of a sensor.
        rotation_of: rig_from_sensor (3, 3) of the sensors that are known; references have I.
        without_place: sensors whose place is not known at all, not even a rotation.
        poses: frames that have a pose.
    """

    frame_of: dict[int, int]
    sensor_of: dict[int, int]
    rig_of: dict[int, int]
    rotation_of: dict[int, Matrix]
    without_place: set[int]
    poses: set[int]

    @property
    def are_trivial(self) -> bool:
        """Whether no frame has two images, and all are taken by references."""
        plain = all(np.array_equal(R, np.eye(3)) for R in self.rotation_of.values())
        one = len(set(self.frame_of.values())) == len(self.frame_of)
        return one and plain and not self.unknown

    @property
    def unknown(self) -> set[int]:
        """Sensors to be estimated."""
        return set(self.sensor_of.values()) - set(self.rotation_of)

    def rows(self, images: IdArray) -> NDArray[np.int64]:
        """Frames (n,) of images (n,)."""
        return np.array([self.frame_of[k] for k in images.tolist()], dtype=np.int64)

    def bodies(self, images: IdArray) -> NDArray[np.int64]:
        """The same, but images of sensors without a place are frames by themselves."""
        found = self.rows(images)
        for k, image in enumerate(images.tolist()):
            if self.sensor_of[image] in self.without_place:
                found[k] = -1 - image
        return found

    def pictures(self, images: Iterable[int]) -> dict[int, tuple[int, int]]:
        """Frame and sensor of these images."""
        return {k: (self.frame_of[k], self.sensor_of[k]) for k in images}


def frames_of(reconstruction: Any, images: Iterable[int], refine_sensors: bool) -> Frames:
    """Look images up in a reconstruction.

    Args:
        reconstruction: `pycolmap.Reconstruction`.
        images: ids.
        refine_sensors: whether sensors are estimated whose place lacks a translation.

    Raises:
        GraphError: an image is not in the reconstruction; a place is not known, and must be.
    """
    found = Frames({}, {}, {}, {}, set(), set())
    for image_id in images:
        if not reconstruction.exists_image(image_id):
            raise GraphError(f"image {image_id} is not in the reconstruction", edge=0)
        image = reconstruction.image(image_id)
        found.frame_of[image_id] = image.frame_id
        sensor = int(image.camera_id)
        found.sensor_of[image_id] = sensor
        frame = reconstruction.frame(image.frame_id)
        if frame.has_pose():
            found.poses.add(image.frame_id)
        if sensor not in found.rig_of:
            found.rig_of[sensor] = frame.rig_id
            _place(found, frame.rig, sensor, image.camera.sensor_id, refine_sensors)
    return found


def _place(found: Frames, rig: Any, sensor: int, sensor_id: Any, refine: bool) -> None:
    if rig.is_ref_sensor(sensor_id):
        found.rotation_of[sensor] = np.eye(3)
        return
    if not rig.has_sensor_from_rig(sensor_id):
        found.without_place.add(sensor)
        good = whole = False
    else:
        place = rig.sensor_from_rig(sensor_id)
        rotation = np.asarray(place.rotation.matrix())
        good = bool(np.isfinite(rotation).all())
        whole = bool(np.isfinite(place.translation).all())
    if not refine and not good:
        raise GraphError(
            f"the place of camera {sensor} in rig {rig.rig_id} is not known, expected a calibrated "
            "rig, or refine_sensor_from_rig",
            edge=0,
        )
    if good and (whole or not refine):
        found.rotation_of[sensor] = convert_family(rotation, "vision")


def largest_component(labels: NDArray[np.int64], pairs: NDArray[np.int32]) -> set[int]:
    """The labels of the largest connected component, the first one of equals.

    Args:
        labels: (n,) of nodes; nodes of one label are one.
        pairs: (k, 2) rows of nodes that are joined; those without any are in no component.
    """
    names, number = np.unique(labels, return_inverse=True)
    first, second = number.reshape(-1)[pairs].reshape(-1, 2).T
    joined = np.zeros(len(names), dtype=bool)
    joined[first] = joined[second] = True
    if not joined.any():
        return set()
    root = np.arange(len(names))
    before = root[:0]
    while not np.array_equal(root, before):  # all roots hang below the least they are joined to
        before = root.copy()
        least = np.minimum(before[first], before[second])
        np.minimum.at(root, before[first], least)
        np.minimum.at(root, before[second], least)
        root = root[root]
    largest = int(np.argmax(np.bincount(root[joined])))
    return set(names[(root == largest) & joined].tolist())
