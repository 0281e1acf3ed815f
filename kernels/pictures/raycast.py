"""The ray caster: light along a ray, one thread a pixel, three passes.

1. `cast_pixels` adds up a pixel's samples. It keeps the unobstructed light of the key light and the sky apart from the
   shares of both that get there, which few samples make noisy.
2. `smooth_light` blurs those two shares over neighbors that lie on the same surface, rows first, then columns.
3. `develop` puts the light together and turns it into the bytes of an sRGB picture.

Rows are dealt out to bands, so that CPU threads can share a picture: a band's thread `row` stands for the picture's row
`band + row * band_count`.
"""

import warp as wp

from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.pictures.surfaces import (
    EPSILON,
    FAR,
    GROUND,
    LINE,
    NOTHING,
    SURFACE,
    Hit,
    Shading,
    Shapes,
    Studio,
    backdrop,
    first_hit,
    ground_fade,
    ground_shading,
    is_film,
    key_share,
    line_shading,
    luminance,
    mirrored_lights,
    mirrored_room,
    sky_share,
    srgb_byte,
    surface_shading,
    tone,
    water_before,
    water_shading,
)

wp.set_module_options({**OPTIONS, "fast_math": True})

LAYERS = wp.constant(3)
"""Largest number of walls and mirrors that a ray passes"""


@wp.struct
class RayLight:
    """Light that comes along a ray."""

    plain: wp.vec3
    """Light without that of key and sky on the first surface"""
    key: wp.vec3
    """Light of the key on the first surface, unshadowed"""
    sky: wp.vec3
    """Light of the sky on the first surface, unoccluded"""
    key_share: wp.vec4
    """Weighted share of the key's light that arrives, and the weight"""
    sky_share: wp.vec4
    """Weighted share of the sky's light that arrives, and the weight"""
    backdrop: float
    """Share of the light that is the backdrop's"""
    place: wp.vec3
    """First surface point"""
    normal: wp.vec3
    caught: float
    """Share of the light that is the ground's, where the ground only catches shadows"""


@wp.func
def with_one(share: wp.vec3):
    """Return a share and its weight, to be summed."""
    return wp.vec4(share[0], share[1], share[2], 1.0)


@wp.func
def shading_of(hit: Hit, studio: Studio, direction: wp.vec3, ground_color: wp.vec3, inside: wp.bool):
    """Return the response of a surface to light, inside a balloon or outside."""
    shading = Shading()
    if hit.kind == SURFACE:
        shading = surface_shading(hit, studio, direction, ground_color, inside)
    elif hit.kind == LINE:
        shading = line_shading(hit, studio, direction, ground_color)
    elif hit.kind == GROUND:
        shading = ground_shading(hit, studio)
    else:
        shading = water_shading(hit, studio, direction, ground_color)
    return shading


@wp.func
def light_farther(hit: Hit, inside: wp.bool, weight: wp.vec3, key: wp.vec3, sky: wp.vec3):
    """Return the light on a surface that is seen through another.

    It gets a share of the light in place of shadows, which nobody misses there.
    """
    light = 0.9 * sky + 0.7 * key
    if is_film(hit):
        light = sky + 0.9 * key
    elif inside:
        # Light there has crossed the wall, too.
        light = wp.cw_mul(weight, 0.8 * sky + 0.7 * key)
    return light


@wp.func
def trace_ray(
    shapes: Shapes,
    studio: Studio,
    origin: wp.vec3,
    direction: wp.vec3,
    behind: wp.vec3,
    disc: wp.vec2,
    asks_key: wp.bool,
    asks_sky: wp.bool,
    catches: wp.bool,
):
    """Return the light along a ray.

    Args:
        behind: Light of the backdrop there.
        disc: Sample point on the lights and of the sky whose visibility is tested.
        asks_key, asks_sky: Whether to test their visibility.
        catches: Whether of the ground only shadows are seen, and those not through anything.
    """
    seen = RayLight()
    start = origin
    along = direction
    far_light = behind
    backdrop = wp.float32(1.0)
    weight = wp.vec3(1.0)
    inside = wp.bool(False)
    layer = wp.int32(0)
    while layer < LAYERS:
        hit = water_before(shapes, start, along, first_hit(shapes, start, along, FAR))
        if layer == 0:
            seen.place = hit.point
            seen.normal = hit.normal
        # A mirror shows the ground all the same.
        clear_ground = catches and hit.kind == GROUND and backdrop > 0.0
        if hit.kind == NOTHING or (clear_ground and layer > 0):
            break
        shading = shading_of(hit, studio, along, shapes.ground_color, inside)
        if hit.kind != SURFACE and hit.kind != LINE:
            fade = ground_fade(hit.point)
            seen.plain += fade * wp.cw_mul(weight, far_light)
            seen.backdrop += fade * backdrop * luminance(weight)
            weight *= 1.0 - fade
            if clear_ground:
                seen.caught = luminance(weight)
        key = wp.cw_mul(weight, shading.key)
        sky = wp.cw_mul(weight, shading.sky)
        seen.plain += wp.cw_mul(weight, shading.lights)
        if layer == 0:
            seen.key = key
            seen.sky = sky
            bright = luminance(key)
            if asks_key and bright > 1.0e-4:
                seen.key_share = bright * with_one(key_share(shapes, studio, hit, disc))
            bright = luminance(sky)
            if asks_sky and bright > 1.0e-4:
                seen.sky_share = bright * with_one(sky_share(shapes, hit, disc))
        else:
            seen.plain += light_farther(hit, inside, weight, key, sky)
        weight = wp.cw_mul(weight, shading.through)
        if luminance(weight) < 0.02:
            return seen
        if shading.mirrors:
            along -= 2.0 * wp.dot(along, hit.normal) * hit.normal
            far_light = mirrored_room(along, hit.finish[0], shapes.ground_color)
            far_light += mirrored_lights(studio, along, hit.finish[0])
            backdrop = 0.0
            start = hit.point + EPSILON * hit.normal
        else:
            start = hit.point + EPSILON * along
            inside = inside != is_film(hit)
        layer += 1
    seen.plain += wp.cw_mul(weight, far_light)
    seen.backdrop += backdrop * luminance(weight)
    return seen


@wp.struct
class Camera:
    """A pinhole, or a thin lens. `right` and `up` reach from the middle of the picture to its edges at distance one."""

    eye: wp.vec3
    forward: wp.vec3
    right: wp.vec3
    up: wp.vec3
    aperture: float
    """Radius of the lens; 0 for a pinhole"""
    focus: float
    """Distance of the plane in focus"""
    transparent: wp.bool
    """Whether to omit the backdrop, and of the ground all but its shadows"""


@wp.func
def lens_place(camera: Camera, disc: wp.vec2):
    """Return a place on the lens."""
    across = disc[0] * wp.normalize(camera.right) + disc[1] * wp.normalize(camera.up)
    return camera.eye + camera.aperture * across


@wp.func
def mean_share(summed: wp.vec4):
    """Return the share from a weighted sum of shares and weights."""
    return wp.vec3(summed[0], summed[1], summed[2]) / wp.max(summed[3], 1.0e-9)


@wp.kernel
def cast_pixels(
    shapes: Shapes,
    studio: Studio,
    camera: Camera,
    pixel_samples: wp.array[wp.vec2],
    disc_samples: wp.array2d[wp.vec2],
    lens_samples: wp.array2d[wp.vec2],
    band: int,
    band_count: int,
    # out
    plain: wp.array2d[wp.vec3],
    key_light: wp.array2d[wp.vec3],
    sky_light: wp.array2d[wp.vec3],
    key_shares: wp.array2d[wp.vec4],
    sky_shares: wp.array2d[wp.vec4],
    places: wp.array2d[wp.vec3],
    normals: wp.array2d[wp.vec3],
    backdrops: wp.array2d[float],
    ground_key: wp.array2d[wp.vec3],
    ground_sky: wp.array2d[wp.vec3],
    ground_shares: wp.array2d[float],
):
    """Cast the rays of a pixel, a thread each; the ground's light is stored apart in a transparent picture."""
    band_row, column = wp.tid()
    row = band + band_row * band_count
    height = places.shape[0]
    width = places.shape[1]
    tile = 4 * (row % 4) + column % 4
    sum_plain = wp.vec3()
    sum_key = wp.vec3()
    sum_sky = wp.vec3()
    sum_key_share = wp.vec4()
    sum_sky_share = wp.vec4()
    sum_backdrop = wp.float32(0.0)
    sum_ground_key = wp.vec3()
    sum_ground_sky = wp.vec3()
    sum_ground = wp.float32(0.0)
    for sample in range(pixel_samples.shape[0]):
        offset = pixel_samples[sample]
        x = 2.0 * (float(column) + offset[0]) / float(width) - 1.0
        y = 1.0 - 2.0 * (float(row) + offset[1]) / float(height)
        toward = camera.forward + x * camera.right + y * camera.up
        origin = camera.eye
        if camera.aperture > 0.0:
            origin = lens_place(camera, lens_samples[sample, tile])
            toward = camera.eye + camera.focus * toward - origin
        behind = wp.cw_mul(studio.paper, backdrop(y, x))
        if camera.transparent:
            behind = wp.vec3()
        # Shares of light are blurred: every other ray's are enough of each.
        disc = disc_samples[sample / 2, tile]
        asks_key = sample % 2 == 0
        asks_sky = sample % 2 == 1 or pixel_samples.shape[0] == 1
        clear = camera.transparent
        seen = trace_ray(shapes, studio, origin, wp.normalize(toward), behind, disc, asks_key, asks_sky, clear)
        sum_plain += seen.plain
        if seen.caught > 0.0:
            sum_ground_key += seen.key
            sum_ground_sky += seen.sky
            sum_ground += seen.caught
        else:
            sum_key += seen.key
            sum_sky += seen.sky
        sum_key_share += seen.key_share
        sum_sky_share += seen.sky_share
        sum_backdrop += seen.backdrop
        if sample == 0:
            places[row, column] = seen.place
            normals[row, column] = seen.normal
    scale = 1.0 / float(pixel_samples.shape[0])
    plain[row, column] = scale * sum_plain
    key_light[row, column] = scale * sum_key
    sky_light[row, column] = scale * sum_sky
    key_shares[row, column] = scale * sum_key_share
    sky_shares[row, column] = scale * sum_sky_share
    backdrops[row, column] = scale * sum_backdrop
    if camera.transparent:
        ground_key[row, column] = scale * sum_ground_key
        ground_sky[row, column] = scale * sum_ground_sky
        ground_shares[row, column] = scale * sum_ground


@wp.kernel
def smooth_light(
    key_shares: wp.array2d[wp.vec4],
    sky_shares: wp.array2d[wp.vec4],
    places: wp.array2d[wp.vec3],
    normals: wp.array2d[wp.vec3],
    radius: int,
    row_step: int,
    column_step: int,
    band: int,
    band_count: int,
    # out
    smooth_key: wp.array2d[wp.vec4],
    smooth_sky: wp.array2d[wp.vec4],
):
    """Smooth light by a Gaussian over pixels of the same surface; a thread a (row of the band, column)."""
    band_row, column = wp.tid()
    row = band + band_row * band_count
    sum_key = key_shares[row, column]
    sum_sky = sky_shares[row, column]
    normal = normals[row, column]
    # Pixels that a translucent or a lit thing touches have some light; the backdrop has none.
    if sum_key[3] + sum_sky[3] > 0.0:
        place = places[row, column]
        falloff = -2.0 / float(radius * radius)
        for step in range(-radius, radius + 1):
            other_row = row + step * row_step
            other_column = column + step * column_step
            inside = other_row >= 0 and other_row < places.shape[0] and other_column >= 0
            if step != 0 and inside and other_column < places.shape[1]:
                alike = wp.max(wp.dot(normal, normals[other_row, other_column]), 0.0)
                alike *= alike
                alike *= alike
                off_plane = wp.abs(wp.dot(normal, places[other_row, other_column] - place))
                weight = alike * alike * wp.exp(falloff * float(step * step) - 80.0 * off_plane)
                sum_key += weight * key_shares[other_row, other_column]
                sum_sky += weight * sky_shares[other_row, other_column]
    smooth_key[row, column] = sum_key
    smooth_sky[row, column] = sum_sky


@wp.func
def catch_shadow(key: wp.vec3, sky: wp.vec3, key_share: wp.vec3, sky_share: wp.vec3, ground: float):
    """Return light and opacity of the ground's shadow alone, which darken any background as they do the ground.

    Pictures are laid over each other by the numbers that are shown: about the power 1/2.2 of the light.

    Args:
        key, sky: unobstructed light of both, times `ground`.
        ground: the share of the pixel that is the ground's.
    """
    most = key + sky
    left = wp.cw_div(wp.cw_mul(key, key_share) + wp.cw_mul(sky, sky_share), wp.max(most, wp.vec3(1.0e-6)))
    shown = wp.vec3()
    for color in range(3):
        shown[color] = wp.pow(wp.clamp(left[color], 0.0, 1.0), 1.0 / 2.2)
    cover = 1.0 - wp.min(shown)
    light = wp.vec3()
    for color in range(3):
        tint = (shown[color] - 1.0 + cover) / wp.max(cover, 1.0e-3)
        light[color] = most[color] * wp.pow(wp.max(tint, 0.0), 2.2)
    return cover * light, cover * ground


@wp.kernel
def develop(
    plain: wp.array2d[wp.vec3],
    key_light: wp.array2d[wp.vec3],
    sky_light: wp.array2d[wp.vec3],
    key_shares: wp.array2d[wp.vec4],
    sky_shares: wp.array2d[wp.vec4],
    backdrops: wp.array2d[float],
    ground_key: wp.array2d[wp.vec3],
    ground_sky: wp.array2d[wp.vec3],
    ground_shares: wp.array2d[float],
    band: int,
    band_count: int,
    # out
    picture: wp.array3d[wp.uint8],
):
    """Convert light to sRGB bytes, with tone curve and opacity; a thread a (row of the band, column)."""
    band_row, column = wp.tid()
    row = band + band_row * band_count
    light = plain[row, column]
    key_share = mean_share(key_shares[row, column])
    sky_share = mean_share(sky_shares[row, column])
    light += wp.cw_mul(key_light[row, column], key_share)
    light += wp.cw_mul(sky_light[row, column], sky_share)
    if picture.shape[2] == 4:
        ground = ground_shares[row, column]
        cover = 1.0 - backdrops[row, column] - ground
        if ground > 0.0:
            added, shadow = catch_shadow(ground_key[row, column], ground_sky[row, column], key_share, sky_share, ground)
            light += added
            cover += shadow
        cover = wp.clamp(cover, 0.0, 1.0)
        light /= wp.max(cover, 1.0e-3)
        picture[row, column, 3] = wp.uint8(255.0 * cover + 0.5)
    shown = tone(light)
    picture[row, column, 0] = srgb_byte(shown[0])
    picture[row, column, 1] = srgb_byte(shown[1])
    picture[row, column, 2] = srgb_byte(shown[2])
