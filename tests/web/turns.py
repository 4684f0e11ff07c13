# SPDX-License-Identifier: MIT
"""Attitudes to turn a probe to, and what the page shows of them."""

from __future__ import annotations

from typing import Any

import numpy as np

import length
from imud import rotation
from web.desk import Desk, Seen

CONVENTIONS = ("nautical", "aerospace", "nectec")

# Yaw, pitch and roll in degrees: round the compass, across 180, through gimbal lock.
TURN = (
    (179.99, 0, 0),
    (-179.99, 10, -20),
    (30, 90, 15),
    (-120, -89.99, -179.99),
    *length.choose(
        everyday=(),
        long=(
            (0, 0, 0),
            (90, 10, -20),
            (-90, 45, 179.9),
            (30, 89.9, 15),
            (30, -90, 15),
            (12.34, -56.78, 90.12),
        ),
    ),
)

SIGMA = """() => {
  const { probe } = globalThis.imud.model;
  const tilt = probe.pose.tilt_sigma_deg;
  const [w, x, y, z] = probe.pose.q;
  const share = Math.hypot(1 - 2 * (y * y + z * z), 2 * (x * y + w * z));
  return Math.hypot(tilt, share * probe.pose.heading_sigma_deg);
}"""

# Where the nose is drawn, and the half axes of the ellipsoids.
PATH = """() => {
  const { scene } = globalThis.imud.view;
  const { position, quaternion } = scene.body;
  const nose = position.clone().set(1.02, 0, 0).applyQuaternion(quaternion);
  const meshes = scene.path.group.children.filter((one) => one.isMesh);
  return {
    tip: nose.add(position).toArray(),
    sizes: meshes.map(({ scale }) => scale.toArray()),
  };
}"""

SLIDE = """(slider, value) => {
  slider.value = value;
  slider.dispatchEvent(new Event("input"));
}"""

# Nothing until the newest pose is drawn.
STATE = """() => {
  const { view, model } = globalThis.imud;
  const { x, y, z, w } = view.scene.body.quaternion;
  const { number, q } = model.probe.pose;
  const drawn = Number(document.querySelector(".numbers").dataset.number);
  return drawn === number && { number, body: [w, x, y, z], q };
}"""


def attitude(yaw: float, pitch: float, roll: float) -> tuple[float, ...]:
    angles = np.deg2rad([yaw, pitch, roll])
    return tuple(map(float, rotation.from_heading_pitch_roll(*angles)))


def pose_on(
    shown: Seen, desk: Desk, q: tuple[float, ...], **fields: Any
) -> dict[str, Any]:
    """Turns the probe and returns what the page shows once it shows that."""
    desk.hand.turn(q, **fields)
    # On the wire a component is a multiple of 2^-30.
    shown.until(
        "q => globalThis.imud.model.probe.pose.q"
        ".every((one, i) => Math.abs(one - q[i]) < 2 ** -29)",
        [*q],
    )
    return shown.until(STATE)


def differences(shown: Seen, want: tuple[float, ...]) -> list[float]:
    """The angles that the page shows, minus those; a whole turn is no difference."""
    is_shown = [shown.number(key) for key in ("yaw", "pitch", "roll")]
    pairs = zip(is_shown, want, strict=True)
    return [(angle - wanted + 180) % 360 - 180 for angle, wanted in pairs]
