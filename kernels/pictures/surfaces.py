"""Surfaces of a picture: shapes that rays hit, their materials, and the light of the studio.

Shapes are triangles, capsules (a sphere is a capsule of no length), ground and water; Y is up. The studio is a
backdrop, a gentle sky, a large key softbox and a strip light opposite, all infinitely far away. Light passes through a
thin wall of dyed rubber: one of thickness one looks like a party balloon's.
"""

import warp as wp


@wp.struct
class Prints:
    """Images, one after the other."""

    texels: wp.array[wp.vec3]
    """Linear RGB, row by row from the top"""
    images: wp.array[wp.vec3i]
    """First texel, width and height of each image"""
    of_triangle: wp.array[wp.int32]
    """Image on each triangle; -1 for none. Empty where there is no image at all"""
    places: wp.array[wp.vec2]
    """Texture coordinates of each corner, from 0 to 1 to the right and up, repeating beyond"""


@wp.func
def texel(prints: Prints, image: wp.vec3i, column: wp.int32, row: wp.int32):
    """Return a texel of an image that repeats beyond its edges."""
    x = column % image[1]
    y = row % image[2]
    if x < 0:
        x += image[1]
    if y < 0:
        y += image[2]
    return prints.texels[image[0] + y * image[1] + x]


@wp.func
def printed_color(prints: Prints, number: wp.int32, place: wp.vec2):
    """Return an image's color at a place, between its four nearest texels."""
    image = prints.images[number]
    x = place[0] * float(image[1]) - 0.5
    y = (1.0 - place[1]) * float(image[2]) - 0.5
    column = wp.int32(wp.floor(x))
    row = wp.int32(wp.floor(y))
    right = x - float(column)
    down = y - float(row)
    above = (1.0 - right) * texel(prints, image, column, row) + right * texel(prints, image, column + 1, row)
    below = (1.0 - right) * texel(prints, image, column, row + 1) + right * texel(prints, image, column + 1, row + 1)
    return (1.0 - down) * above + down * below


@wp.struct
class Shapes:
    """Shapes to draw, in a frame where the action is about one unit large."""

    mesh: wp.uint64
    """Triangles of all meshes; 0 where there are none"""
    corners: wp.array[wp.int32]
    """Vertex numbers, three a triangle"""
    normals: wp.array[wp.vec3]
    """Unit normals, one a vertex"""
    colors: wp.array[wp.vec3]
    """Linear RGB, one a corner: faces that share a vertex may differ there"""
    shrunk: wp.array[float]
    """Area about a vertex before over that now, one a vertex"""
    finishes: wp.array[wp.vec4]
    """Roughness, opacity, clearcoat and metallic, one a triangle"""
    prints: Prints
    """Images on triangles, in place of colors"""
    capsules: wp.uint64
    """Boxes of the capsules; 0 where there are none"""
    begins: wp.array[wp.vec3]
    ends: wp.array[wp.vec3]
    radii: wp.array[float]
    capsule_colors: wp.array[wp.vec3]
    capsule_finishes: wp.array[wp.vec4]
    reach: float
    """Distance from the origin within which all triangles and capsules are"""
    has_ground: wp.int32
    ground_height: float
    ground_color: wp.vec3
    has_water: wp.int32
    water_height: float
    water_color: wp.vec3


@wp.struct
class Hit:
    """First intersection of a ray, with `color`, `finish` and `shrunk` of the material there."""

    kind: wp.int32
    distance: float
    point: wp.vec3
    normal: wp.vec3
    color: wp.vec3
    finish: wp.vec4
    shrunk: float


LEAST_SEEN = wp.constant(0.6)
"""Least cosine of a smooth normal to the viewer, over that of its face's own"""
NOTHING = wp.constant(0)
SURFACE = wp.constant(1)
LINE = wp.constant(2)
GROUND = wp.constant(3)
WATER = wp.constant(4)


@wp.func
def capsule_distance(origin: wp.vec3, direction: wp.vec3, begin: wp.vec3, end: wp.vec3, radius: float):
    """Return the distance along a ray of unit direction to a capsule's outside; -1 where it misses or starts inside.

    The cylinder around the axis first, then whichever round cap the ray enters.
    """
    axis = end - begin
    # From the ray's point beside the capsule's middle: from afar, a thin line's radius would drown in round-off.
    beside = wp.dot(0.5 * (begin + end) - origin, direction)
    arm = origin + beside * direction - begin
    axis_axis = wp.dot(axis, axis)
    axis_direction = wp.dot(axis, direction)
    axis_arm = wp.dot(axis, arm)
    a = axis_axis - axis_direction * axis_direction
    b = axis_axis * wp.dot(arm, direction) - axis_arm * axis_direction
    c = axis_axis * (wp.dot(arm, arm) - radius * radius) - axis_arm * axis_arm
    near_end = bool(False)
    if a > 1.0e-7 * axis_axis:
        discriminant = b * b - a * c
        if discriminant < 0.0:
            return -1.0
        t = (-b - wp.sqrt(discriminant)) / a
        along = axis_arm + t * axis_direction
        if along > 0.0 and along < axis_axis:
            return beside + t
        near_end = along >= axis_axis
    else:
        near_end = axis_direction < 0.0
    if near_end:
        arm -= axis
    half_b = wp.dot(direction, arm)
    across = arm - half_b * direction
    discriminant = radius * radius - wp.dot(across, across)
    if discriminant < 0.0:
        return -1.0
    return beside - half_b - wp.sqrt(discriminant)


@wp.func
def nearest_capsule(shapes: Shapes, origin: wp.vec3, direction: wp.vec3, reach: float):
    """Return the first capsule along a ray and its distance; number -1 where there is none within `reach`."""
    nearest = wp.int32(-1)
    distance = float(reach)
    if shapes.capsules != wp.uint64(0):
        query = wp.bvh_query_ray(shapes.capsules, origin, direction)
        capsule = wp.int32(0)
        while wp.bvh_query_next(query, capsule, distance):
            t = capsule_distance(origin, direction, shapes.begins[capsule], shapes.ends[capsule], shapes.radii[capsule])
            if t > 0.0 and t < distance:
                distance = t
                nearest = capsule
    return nearest, distance


@wp.func
def capsule_normal(shapes: Shapes, capsule: wp.int32, point: wp.vec3):
    """Return the outward unit normal of a capsule at a point on it."""
    begin = shapes.begins[capsule]
    axis = shapes.ends[capsule] - begin
    along = wp.dot(point - begin, axis) / wp.max(wp.dot(axis, axis), 1.0e-20)
    return wp.normalize(point - begin - wp.clamp(along, 0.0, 1.0) * axis)


@wp.func
def turned_to_viewer(smooth: wp.vec3, facing: wp.vec3, direction: wp.vec3):
    """Return a smooth normal, bent toward the viewer where its face is seen by much less of a slant than it says.

    Near the outline of a coarse mesh a smooth normal looks away over a whole polygon, which would be a gray shard: all
    of it mirrors as if it were seen edge-on.

    Args:
        facing: the face's own normal; both are unit vectors on the viewer's side of the face.
        direction: of the ray.
    """
    seen = -wp.dot(smooth, direction)
    least = -LEAST_SEEN * wp.dot(facing, direction)
    across = smooth + seen * direction
    length = wp.length(across)
    if seen >= least or length < 1.0e-6:
        return smooth
    return wp.sqrt(1.0 - least * least) / length * across - least * direction


@wp.func
def first_hit(shapes: Shapes, origin: wp.vec3, direction: wp.vec3, reach: float):
    """Return the first hit along a ray of unit direction, within `reach`.

    Its normal is smooth and faces the origin.
    """
    hit = Hit()
    hit.kind = NOTHING
    hit.distance = reach
    # Most rays of the ground's shadows go nowhere near anything.
    beside = wp.max(-wp.dot(origin, direction), 0.0)
    near = wp.length_sq(origin + beside * direction) < shapes.reach * shapes.reach
    if near and shapes.mesh != wp.uint64(0):
        query = wp.mesh_query_ray(shapes.mesh, origin, direction, reach)
        if query.result:
            hit.kind = SURFACE
            hit.distance = query.t
            a = shapes.corners[3 * query.face]
            b = shapes.corners[3 * query.face + 1]
            c = shapes.corners[3 * query.face + 2]
            w = 1.0 - query.u - query.v
            corner = 3 * query.face
            hit.color = query.u * shapes.colors[corner] + query.v * shapes.colors[corner + 1]
            hit.color += w * shapes.colors[corner + 2]
            if shapes.prints.of_triangle.shape[0] > 0 and shapes.prints.of_triangle[query.face] >= 0:
                place = query.u * shapes.prints.places[corner] + query.v * shapes.prints.places[corner + 1]
                place += w * shapes.prints.places[corner + 2]
                hit.color = printed_color(shapes.prints, shapes.prints.of_triangle[query.face], place)
            hit.finish = shapes.finishes[query.face]
            hit.shrunk = query.u * shapes.shrunk[a] + query.v * shapes.shrunk[b] + w * shapes.shrunk[c]
            smooth = query.u * shapes.normals[a] + query.v * shapes.normals[b] + w * shapes.normals[c]
            facing = query.normal
            if wp.dot(facing, direction) > 0.0:
                facing = -facing
            if wp.dot(smooth, facing) < 0.0:
                smooth = -smooth
            hit.normal = turned_to_viewer(wp.normalize(smooth), facing, direction)
    capsule = wp.int32(-1)
    distance = float(0.0)
    if near:
        capsule, distance = nearest_capsule(shapes, origin, direction, hit.distance)
    if capsule >= 0:
        is_ball = shapes.begins[capsule] == shapes.ends[capsule]
        hit.kind = wp.where(is_ball, SURFACE, LINE)
        hit.distance = distance
        hit.normal = capsule_normal(shapes, capsule, origin + distance * direction)
        hit.color = shapes.capsule_colors[capsule]
        hit.finish = shapes.capsule_finishes[capsule]
        hit.shrunk = 1.0
    if shapes.has_ground != 0 and direction[1] * (origin[1] - shapes.ground_height) < 0.0:
        t = (shapes.ground_height - origin[1]) / direction[1]
        if t < hit.distance:
            hit.kind = GROUND
            hit.distance = t
            hit.normal = wp.vec3(0.0, wp.where(direction[1] < 0.0, 1.0, -1.0), 0.0)
            hit.color = shapes.ground_color
            hit.finish = wp.vec4(1.0, 1.0, 0.0, 0.0)
    hit.point = origin + hit.distance * direction
    return hit


@wp.func
def water_before(shapes: Shapes, origin: wp.vec3, direction: wp.vec3, hit: Hit):
    """Return the water's surface where a ray meets it first, else the given hit.

    Not a part of `first_hit`, since things under water are lit as if there were none.
    """
    if shapes.has_water != 0 and direction[1] * (origin[1] - shapes.water_height) < 0.0:
        t = (shapes.water_height - origin[1]) / direction[1]
        if t < hit.distance:
            hit.kind = WATER
            hit.distance = t
            hit.point = origin + t * direction
            hit.normal = wp.vec3(0.0, wp.where(direction[1] < 0.0, 1.0, -1.0), 0.0)
            hit.color = shapes.water_color
    return hit


KEY = (-0.62, 1.0, 0.62)
"""Direction to the key light: to the right, up, and back toward the camera"""
KEY_RADIANCE = (1.06, 1.02, 0.96)
"""Radiance that the key light adds to a white surface facing it"""


@wp.struct
class Studio:
    """Lights of the studio. Directions are unit vectors toward the light; Y is up."""

    key: wp.vec3
    """Direction of the key softbox"""
    key_right: wp.vec3
    key_up: wp.vec3
    rim: wp.vec3
    """Direction of the strip light"""
    rim_right: wp.vec3
    rim_up: wp.vec3
    key_radiance: wp.vec3
    """Radiance that the key light adds to a white surface facing it"""
    paper: wp.vec3
    """Tint of the backdrop"""
    key_spread: float
    """Tangent of the half angle of the key light, for soft shadows"""


@wp.func
def mix(a: wp.vec3, b: wp.vec3, t: float):
    """Interpolate linearly from a at 0 to b at 1."""
    return a + t * (b - a)


@wp.func
def luminance(color: wp.vec3):
    """Return the luminance of a color, by Rec. 709 weights."""
    return wp.dot(color, wp.vec3(0.2126, 0.7152, 0.0722))


@wp.func
def backdrop(height: float, across: float):
    """Return the light of the backdrop, a warm paper sweep.

    Both arguments run from -1 to 1 over the picture.
    """
    light = mix(wp.vec3(0.90, 0.86, 0.80), wp.vec3(0.86, 0.83, 0.80), wp.smoothstep(-0.6, 1.3, height))
    corner = across * across + 0.6 * height * height
    return light * (1.0 - 0.12 * wp.smoothstep(0.2, 1.8, corner))


@wp.func
def sky_irradiance(normal: wp.vec3, ground_color: wp.vec3):
    """Return the diffuse light from all around, softboxes apart, on a surface that nothing shadows."""
    from_sky = mix(wp.vec3(0.26, 0.27, 0.30), wp.vec3(0.36, 0.36, 0.36), 0.5 + 0.5 * normal[1])
    return mix(0.34 * ground_color, from_sky, wp.smoothstep(-1.0, 0.7, normal[1]))


@wp.func
def panel(direction: wp.vec3, toward: wp.vec3, right: wp.vec3, up: wp.vec3, half: wp.vec2, blur: float):
    """Return the visible fraction of a soft-edged rectangular light along a direction.

    `half` is its half size at distance one.
    """
    ahead = wp.dot(direction, toward)
    if ahead <= 0.05:
        return 0.0
    x = wp.abs(wp.dot(direction, right)) / ahead
    y = wp.abs(wp.dot(direction, up)) / ahead
    inside_x = 1.0 - wp.smoothstep(half[0] - blur, half[0] + blur, x)
    inside_y = 1.0 - wp.smoothstep(half[1] - blur, half[1] + blur, y)
    # A blurred light spreads its power over a larger area.
    return inside_x * inside_y * half[0] * half[1] / ((half[0] + 0.5 * blur) * (half[1] + 0.5 * blur))


@wp.func
def softbox(direction: wp.vec3, toward: wp.vec3, right: wp.vec3, up: wp.vec3, half: wp.vec2, blur: float):
    """Return the light of a softbox, brightest where its lamp is, with a bar across the middle of its frame."""
    light = panel(direction, toward, right, up, half, blur)
    if light > 0.0:
        ahead = wp.max(wp.dot(direction, toward), 0.05)
        x = wp.dot(direction, right) / (ahead * half[0])
        y = wp.dot(direction, up) / (ahead * half[1])
        bar = 0.035 / half[1]
        soft = bar + 1.5 * blur / half[1]
        across = 1.0 - bar / soft * (1.0 - wp.smoothstep(0.5 * soft, soft, wp.abs(y)))
        light *= across * (1.12 - 0.3 * wp.min(x * x + y * y, 1.5))
    return light


@wp.func
def mirrored_room(direction: wp.vec3, roughness: float, ground_color: wp.vec3):
    """Return the light that a surface of some roughness mirrors from a direction, without the lights.

    A floor that is bright near by, a wall that is dark where it meets the floor, and a large white cloth overhead.
    """
    soft = 0.04 + 0.6 * roughness
    floor = mix(0.45 * ground_color, 0.8 * ground_color, wp.smoothstep(-0.9, -0.1, direction[1]))
    wall = mix(wp.vec3(0.30, 0.29, 0.29), wp.vec3(0.62, 0.64, 0.68), wp.smoothstep(-0.05, 0.55, direction[1]))
    above = mix(wall, wp.vec3(1.25, 1.25, 1.25), wp.smoothstep(0.72 - soft, 0.72 + soft, direction[1]))
    return mix(floor, above, wp.smoothstep(-soft, soft, direction[1]))


@wp.func
def mirrored_lights(studio: Studio, direction: wp.vec3, roughness: float):
    """Return the light that a surface of some roughness mirrors of the two lights."""
    blur = 0.03 + 0.9 * roughness * roughness
    key = softbox(direction, studio.key, studio.key_right, studio.key_up, wp.vec2(0.34, 0.44), blur)
    rim = panel(direction, studio.rim, studio.rim_right, studio.rim_up, wp.vec2(0.14, 0.70), blur)
    return key * wp.vec3(28.0, 27.4, 26.4) + rim * wp.vec3(8.0, 8.3, 8.8)


USUAL = wp.constant(0.08)
"""Transparency, one less the material's opacity, of an unstretched wall of thickness one"""
CLOUDY = wp.constant(0.8)
"""Exponent of scattering for a wall of thickness one, which scatters all but exp(-CLOUDY) of the light"""
DYED = wp.constant(0.56)
"""Power of its color that a wall of thickness one transmits: two such walls show about the color itself"""
PALER = wp.constant(0.6)
"""Power of the thickness that shows"""
DEEPEST = wp.constant(3.4)
"""Relative path length through a wall at the silhouette, seen edge-on"""


@wp.struct
class Wall:
    """Shares of the light, by color."""

    clear: wp.vec3
    """Fraction of the light that passes unscattered"""
    back: wp.vec3
    """Fraction of the light that is scattered back"""
    forth: wp.vec3
    """Fraction of the light that is scattered to the other side"""


@wp.func
def thickness_of(opacity: float, shrunk: float):
    """Return the thickness of a wall: it grows with the material's opacity, and falls with stretch.

    Args:
        shrunk: Area before over area now. Rubber keeps its volume, so that it is the thickness, too. Its power is a
            matter of looks: walls stretched fourfold both ways would hardly be seen.
    """
    return wp.pow(shrunk, PALER) * USUAL / wp.max(1.0 - opacity, 1.0e-6)


@wp.func
def dyed(color: wp.vec3, power: float):
    """Return a color to a power, as in Beer and Lambert's law.

    A color without one component still lets a little of it through.
    """
    return wp.vec3(
        wp.pow(wp.clamp(color[0], 0.02, 1.0), power),
        wp.pow(wp.clamp(color[1], 0.02, 1.0), power),
        wp.pow(wp.clamp(color[2], 0.02, 1.0), power),
    )


@wp.func
def wall_of(color: wp.vec3, thickness: float, facing: float):
    """Return a wall that light meets under an angle.

    Args:
        facing: the angle's cosine; the way through is the longer, the smaller it is.
    """
    path = thickness / (facing + (1.0 - facing) / DEEPEST)
    clear = wp.exp(-CLOUDY * path)
    through = dyed(color, wp.min(DYED * path, 2.2))
    # Light that comes back has met less and less of a thick wall: the rest is the color of the dye.
    forth = (1.0 - clear) / (1.0 + path)
    wall = Wall()
    wall.clear = clear * through
    wall.forth = forth * through
    wall.back = (1.0 - clear - forth) * dyed(color, wp.min(0.55 + 0.4 * path, 1.35))
    return wall


@wp.func
def passes(wall: Wall):
    """Return the share of light that gets through, scattered or not."""
    return wall.clear + wall.forth


@wp.func
def glow(wall: Wall, key_radiance: wp.vec3):
    """Return the uniform light inside a balloon on its wall, from multiple scattering."""
    entered = wp.cw_mul(passes(wall), 0.5 * key_radiance + wp.vec3(0.6))
    return entered + wp.cw_mul(entered, wall.back)


FAR = wp.constant(1.0e4)
EPSILON = wp.constant(1.0e-3)
"""Offset of rays from a surface, in sizes of the action"""
MURK = wp.constant(0.3)
"""Fraction of the light that water reflects diffusely"""
REACH = wp.constant(0.7)
"""Range of ambient occlusion"""
WALLS = wp.constant(4)
"""Largest number of rubber walls that shadow rays pass"""


@wp.struct
class Shading:
    """Light that a surface sends to the viewer."""

    key: wp.vec3
    """Light from the key, unshadowed"""
    sky: wp.vec3
    """Light from the sky, unoccluded"""
    lights: wp.vec3
    """Mirror images of the lights"""
    through: wp.vec3
    """Share, by color, of the light behind the surface, or of its mirror image"""
    mirrors: wp.bool
    """Whether the ray goes on by mirror reflection"""


@wp.func
def ground_fade(point: wp.vec3):
    """Return the fraction of the backdrop in the ground's color: a studio's paper sweep has no horizon."""
    return wp.smoothstep(1.0, 6.0, wp.sqrt(point[0] * point[0] + point[2] * point[2]))


@wp.func
def ground_shading(hit: Hit, studio: Studio):
    """Return the response of the matte ground."""
    shading = Shading()
    shading.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(hit.color, studio.key_radiance)
    shading.sky = wp.cw_mul(hit.color, sky_irradiance(hit.normal, hit.color))
    return shading


@wp.func
def water_shading(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Return the response of water: clear from above, a mirror at grazing angles, a little murky, so that shadows show.

    Args:
        direction: of the ray that hit.
    """
    facing = -wp.dot(hit.normal, direction)
    # Schlick's approximation for an index of 1.33, held back, or the room would hide things under water.
    fresnel = 0.02 + 0.4 * wp.pow(1.0 - facing, 5.0)
    shading = Shading()
    shading.key = MURK * (1.0 - fresnel) * wp.max(wp.dot(hit.normal, studio.key), 0.0) * hit.color
    shading.key = wp.cw_mul(shading.key, studio.key_radiance)
    shading.sky = MURK * (1.0 - fresnel) * wp.cw_mul(hit.color, sky_irradiance(hit.normal, ground_color))
    shading.through = (1.0 - MURK) * (1.0 - fresnel) * mix(wp.vec3(1.0), hit.color, 0.2)
    mirrored = direction + 2.0 * facing * hit.normal
    shading.lights = fresnel * (mirrored_room(mirrored, 0.0, ground_color) + mirrored_lights(studio, mirrored, 0.0))
    return shading


@wp.func
def line_shading(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Return the response of a line: an even color, since it is too thin for shading."""
    facing = wp.abs(wp.dot(hit.normal, direction))
    light = 0.5 * studio.key_radiance + sky_irradiance(hit.normal, ground_color)
    shading = Shading()
    shading.lights = (0.6 + 0.4 * facing) * wp.cw_mul(hit.color, light)
    return shading


@wp.func
def is_film(hit: Hit):
    """Return whether a hit is a translucent wall."""
    return hit.kind == SURFACE and hit.finish[1] < 1.0 and hit.finish[3] == 0.0


@wp.func
def film_at(hit: Hit, direction: wp.vec3):
    """Return the wall that a ray has hit."""
    thickness = thickness_of(hit.finish[1], hit.shrunk)
    return wall_of(hit.color, thickness, wp.abs(wp.dot(hit.normal, direction)))


@wp.func
def film_shading(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3, inside: wp.bool):
    """Return the response of a wall of dyed rubber with light on both sides.

    Args:
        direction: of the ray that hit.
        inside: whether it came from within the balloon.
    """
    shading = Shading()
    wall = film_at(hit, direction)
    shut = glow(wall, studio.key_radiance)
    toward_key = wp.dot(hit.normal, studio.key)
    front, behind = wp.max(toward_key, 0.0), wp.max(-toward_key, 0.0)
    if inside:
        came_in = front * wp.cw_mul(wall.back, passes(wall)) + behind * wall.forth
        shading.key = wp.cw_mul(came_in, studio.key_radiance)
        shading.sky = wp.cw_mul(wall.forth, sky_irradiance(-hit.normal, ground_color)) + wp.cw_mul(wall.back, shut)
    else:
        # Light from behind has crossed the far wall, too: the shadow's ray finds its share.
        shading.key = wp.cw_mul(front * wall.back + behind * wall.forth, studio.key_radiance)
        shading.sky = wp.cw_mul(wall.back, sky_irradiance(hit.normal, ground_color)) + wp.cw_mul(wall.forth, shut)
    shading.through = wall.clear
    return shading


@wp.func
def metal_shading(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3):
    """Return the response of a tinted mirror, which is a little dull."""
    shading = Shading()
    grazing = 1.0 + wp.dot(hit.normal, direction)
    dull = 0.1 * hit.color
    shading.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(dull, studio.key_radiance)
    shading.sky = wp.cw_mul(dull, sky_irradiance(hit.normal, ground_color))
    shading.through = 0.9 * mix(hit.color, wp.vec3(1.0), wp.pow(grazing, 5.0))
    shading.mirrors = True
    return shading


@wp.func
def surface_shading(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3, inside: wp.bool):
    """Return the response of a dyed body under a clear gloss, a thin wall of rubber under one, or metal.

    Args:
        direction: of the ray that hit.
        inside: whether it came from within a balloon.
    """
    shading = Shading()
    if hit.finish[3] > 0.0:
        shading = metal_shading(hit, studio, direction, ground_color)
    else:
        facing = -wp.dot(hit.normal, direction)
        # Schlick's approximation for an index of 1.5, held back where it would outline the silhouette.
        fresnel = 0.04 + 0.5 * wp.pow(1.0 - facing, 5.0)
        gloss = fresnel * wp.max(hit.finish[2], 1.0 - hit.finish[0])
        if is_film(hit):
            shading = film_shading(hit, studio, direction, ground_color, inside)
            shading.through *= 1.0 - fresnel
            gloss *= wp.where(inside, 0.5 * luminance(shading.through) + 0.1, 1.0)
        else:
            shading.key = wp.max(wp.dot(hit.normal, studio.key), 0.0) * wp.cw_mul(hit.color, studio.key_radiance)
            shading.sky = wp.cw_mul(hit.color, sky_irradiance(hit.normal, ground_color))
        roughness = hit.finish[0] * (1.0 - 0.9 * hit.finish[2])
        mirrored = direction + 2.0 * facing * hit.normal
        shading.key *= 1.0 - fresnel
        shading.sky = (1.0 - fresnel) * shading.sky + gloss * mirrored_room(mirrored, roughness, ground_color)
        shading.lights = gloss * mirrored_lights(studio, mirrored, roughness)
    return shading


@wp.func
def key_share(shapes: Shapes, studio: Studio, hit: Hit, disc: wp.vec2):
    """Return the share of the key light, by color, that arrives from one point of it, on the side facing it."""
    across = studio.key_spread * (disc[0] * studio.key_right + disc[1] * studio.key_up)
    direction = wp.normalize(studio.key + across)
    side = wp.where(wp.dot(hit.normal, studio.key) < 0.0, -EPSILON, EPSILON)
    origin = hit.point + side * hit.normal
    share = wp.vec3(1.0)
    walls = wp.int32(0)
    while walls < WALLS:
        blocker = first_hit(shapes, origin, direction, FAR)
        if blocker.kind == NOTHING:
            return share
        if not is_film(blocker):
            return wp.vec3(0.0)
        share = wp.cw_mul(share, passes(film_at(blocker, direction)))
        origin = blocker.point + EPSILON * direction
        walls += 1
    return share


@wp.func
def tangent_frame(normal: wp.vec3):
    """Return two unit vectors across a unit vector."""
    helper = wp.where(wp.abs(normal[1]) < 0.9, wp.vec3(0.0, 1.0, 0.0), wp.vec3(1.0, 0.0, 0.0))
    right = wp.normalize(wp.cross(helper, normal))
    return right, wp.cross(normal, right)


@wp.func
def sky_share(shapes: Shapes, hit: Hit, disc: wp.vec2):
    """Return the share of the sky's light, by color, along one direction.

    A surface there adds some of its own color.
    """
    right, forward = tangent_frame(hit.normal)
    up = wp.sqrt(wp.max(1.0 - wp.dot(disc, disc), 0.0))
    direction = wp.normalize(disc[0] * right + disc[1] * forward + up * hit.normal)
    blocker = first_hit(shapes, hit.point + EPSILON * hit.normal, direction, REACH)
    if blocker.kind == NOTHING:
        return wp.vec3(1.0)
    bounce = 0.45 * blocker.color
    if blocker.kind == GROUND:
        bounce = 0.35 * blocker.color
    elif is_film(blocker):
        bounce += 0.35 * passes(film_at(blocker, direction))
    return mix(bounce, wp.vec3(1.0), blocker.distance / REACH)


@wp.func
def tone(light: wp.vec3):
    """Map tones by Khronos PBR Neutral (2024): it keeps the colors of things, and compresses only highlights."""
    low = wp.min(light)
    lifted = wp.where(low < 0.08, low - 6.25 * low * low, 0.04)
    color = light - wp.vec3(lifted)
    peak = wp.max(color)
    if peak < 0.76:
        return color
    shown = 1.0 - 0.24 * 0.24 / (peak + 0.24 - 0.76)
    return mix(wp.vec3(shown), (shown / peak) * color, 1.0 / (0.15 * (peak - shown) + 1.0))


@wp.func
def srgb_byte(shown: float):
    """Return the sRGB transfer function (IEC 61966-2-1), in 256 steps."""
    encoded = 12.92 * shown
    if shown > 0.0031308:
        encoded = 1.055 * wp.pow(wp.min(shown, 1.0), 1.0 / 2.4) - 0.055
    return wp.uint8(255.0 * encoded + 0.5)
