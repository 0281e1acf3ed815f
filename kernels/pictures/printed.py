"""Images that are printed on surfaces."""

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
