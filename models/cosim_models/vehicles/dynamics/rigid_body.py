"""Rigid-body mechanics over tuples: the rotation matrix and Euler's equation.

Body axes are FRD (forward, right, down). The reference frame is NED (north, east, down) and inertial (flat,
non-rotating Earth). Quaternions are (w, x, y, z) and rotate FRD into NED. Integration and forces are elsewhere.

Source: B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation, 3rd ed., chapter 1.
"""

from __future__ import annotations

from typing import Any

from cosim.kernel import kernel

__all__ = [
    "Matrix",
    "Quaternion",
    "Vector",
    "along",
    "along4",
    "angular_acceleration",
    "from_body",
    "load",
    "load4",
    "rotation_matrix",
    "to_body",
]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]


@kernel
def load(a: Any) -> Vector:
    """Returns the first three elements of an array as a tuple."""
    return (float(a[0]), float(a[1]), float(a[2]))


@kernel
def load4(a: Any) -> Quaternion:
    """Returns the first four elements of an array as a tuple."""
    return (float(a[0]), float(a[1]), float(a[2]), float(a[3]))


@kernel
def along(x: Vector, h: float, rate: Vector) -> Vector:
    """Returns x + h * rate."""
    return (x[0] + h * rate[0], x[1] + h * rate[1], x[2] + h * rate[2])


@kernel
def along4(x: Quaternion, h: float, rate: Quaternion) -> Quaternion:
    """Returns x + h * rate."""
    return (x[0] + h * rate[0], x[1] + h * rate[1], x[2] + h * rate[2], x[3] + h * rate[3])


@kernel
def rotation_matrix(q: Quaternion) -> Matrix:
    """Returns the rotation matrix of unit quaternion `q`, row by row: NED = R FRD."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@kernel
def from_body(r: Matrix, v: Vector) -> Vector:
    """Returns R v: transforms a vector from FRD to NED."""
    x, y, z = v
    return (r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z, r[6] * x + r[7] * y + r[8] * z)


@kernel
def to_body(r: Matrix, v: Vector) -> Vector:
    """Returns R' v: transforms a vector from NED to FRD."""
    x, y, z = v
    return (r[0] * x + r[3] * y + r[6] * z, r[1] * x + r[4] * y + r[7] * z, r[2] * x + r[5] * y + r[8] * z)


@kernel
def angular_acceleration(inertia: Vector, per_inertia: Vector, rates: Vector, torque: Vector, spin: float) -> Vector:
    """Solves Euler's equation in principal axes: I dw/dt = torque - w x (I w + spin e_down) [rad/s2, FRD].

    Args:
        inertia: principal moments of inertia [kg m2].
        per_inertia: their reciprocals [1/(kg m2)].
        rates: angular velocity w [rad/s, FRD].
        torque: torque about the centre of mass [N m, FRD].
        spin: angular momentum of the rotors about the down axis, relative to the body [kg m2/s].
    """
    p, q, r = rates
    hx, hy, hz = inertia[0] * p, inertia[1] * q, inertia[2] * r + spin
    return (
        (torque[0] - (q * hz - r * hy)) * per_inertia[0],
        (torque[1] - (r * hx - p * hz)) * per_inertia[1],
        (torque[2] - (p * hy - q * hx)) * per_inertia[2],
    )
