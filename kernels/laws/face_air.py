"""Air that moves past a face: lift and drag (Wejchert and Haumann, *Animation Aerodynamics*, 1991)."""

from typing import Any

import warp as wp

from balloon_warp.kernels.laws.air import AIR, WIND, drag_bound
from balloon_warp.kernels.laws.law import Law, Parameter


@wp.func
def air_on_face(velocity: wp.vec3, area_vector: wp.vec3, air: wp.vec4, face_drag: float, face_friction: float):
    """Force of the air on a face [N]: -1/2 density A |u| (C_n u_n + C_t u_t).

    u is the velocity relative to the air, u_n its part along the face's normal, u_t that along the face. A plate of one
    sheet at the angle a to the flow so gets 1/2 density A C_n u^2 sin a along its normal: the lift is cos a of that,
    the drag sin a. On a closed body both sides count: a sphere gets C_d = 4/3 C_n + 8/3 C_t, two sheets twice the force
    of one.
    """
    relative = velocity - wp.vec3(air[0], air[1], air[2])
    area = wp.length(area_vector)
    normal = area_vector / wp.max(area, 1.0e-20)
    across = wp.dot(relative, normal) * normal
    push = face_drag * across + face_friction * (relative - across)
    return (-0.5 * air[3] * area * wp.length(relative)) * push


def face_air_bound(
    area: Any,
    velocity: Any,
    air_pressure: Any,
    air_temperature: Any,
    air_density: Any,
    wind: Any,
    wind_shear: Any,
    wind_height: Any,
    wind_roughness: Any,
    gusts: Any,
    face_drag: Any,
    face_friction: Any,
) -> Any:
    """Return density C A u [N s/m], where C is the larger coefficient, or at most their sum."""
    both = face_drag + face_friction
    given = (wind, wind_shear, wind_height, wind_roughness, gusts)
    return drag_bound(area, velocity, air_pressure, air_temperature, air_density, both, *given)


FACE_AIR = Law(
    "face",
    air_on_face,
    (
        *AIR,
        *WIND,
        Parameter(
            "face_drag",
            "1",
            least=0.0,
            path="face_drag",
            meaning="Normal coefficient C_n of each face in the air: 1/2 density C_n A |u| u_n against the part of u "
            "along the face's normal; it gives lift and drag",
        ),
        Parameter(
            "face_friction",
            "1",
            least=0.0,
            path="face_friction",
            meaning="Tangential coefficient C_t of the air's force along each face, with C_t in place of C_n",
        ),
    ),
    neutral={"face_drag": 0.0, "face_friction": 0.0},
    drag=face_air_bound,
)
