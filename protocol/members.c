/* The table of scene members. A new member is added here and as a field in renderer/scene/scene.h, nowhere else. */
#include "protocol/internal.h"

static const char *const formats[] = {"jpeg", "png", NULL};
static const char *const subsamplings[] = {"auto", "4:4:4", "4:2:2", "4:2:0", NULL};
static const char *const projections[] = {"perspective", "orthographic", NULL};
static const char *const skipping_modes[] = {"auto", "off", NULL};
static const char *const orientations[] = {"axial", "coronal", "sagittal", "oblique", NULL};

#define SAME_COUNT(names, count) G_STATIC_ASSERT(G_N_ELEMENTS(names) == (count) + 1)
SAME_COUNT(formats, TC_FORMAT_COUNT);
SAME_COUNT(subsamplings, TC_SUBSAMPLING_COUNT);
SAME_COUNT(projections, TC_PROJECTION_COUNT);
SAME_COUNT(skipping_modes, TC_SKIPPING_COUNT);
SAME_COUNT(orientations, TC_MPR_ORIENTATION_COUNT);

#define AT(field) .offset = offsetof(tc_scene, field)
#define RANGE(lo, hi) .min = (lo), .max = (hi)
#define VALUES RANGE(-TCP_MAX_VALUE, TCP_MAX_VALUE)
#define COORDINATES RANGE(-TCP_MAX_COORDINATE, TCP_MAX_COORDINATE)
#define UNIT RANGE(0, 1)

const tcp_group tcp_groups[] = {
    {"image", "Size and encoding of the picture."},
    {"camera", "The view. Positions are mm in patient LPS."},
    {"transferFunction", "Colour and opacity of each value; constant beyond the first and the last knot."},
    {"window", "Which values span black to white (mip, minip, average, mpr)."},
    {"sampling", "How densely rays are sampled."},
    {"skipping", "Empty-space skipping."},
    {"shading", "Light on surfaces in the volume."},
    {"clip", "What part of the volume is shown."},
    {"isosurface", "The surface of modes isosurface and mesh."},
    {"mesh", "Mode mesh: several surfaces at once."},
    {"splat", "Mode splat: voxels drawn one by one."},
    {"mpr", "Mode mpr: a reformatted slice or slab."},
    {"labels", "A second volume whose values are labels, drawn over the first."},
    {"quality", "Lets the renderer choose the sampling; one of the two at most, the newer one stays."},
    {"errorMeter", "Compares random pixels with the reference integrator."},
};
const size_t tcp_group_count = G_N_ELEMENTS(tcp_groups);

const tcp_member tcp_members[] = {
    {"", "mode", TCP_NAME, AT(mode), .names = tc_mode_names, .doc = "How the volume becomes a picture."},

    {"image", "width", TCP_INTEGER, AT(image.width), RANGE(1, TC_MAX_IMAGE_SIDE), .flags = TCP_LIMIT, .unit = "pixels",
     .doc = "Width of the picture."},
    {"image", "height", TCP_INTEGER, AT(image.height), RANGE(1, TC_MAX_IMAGE_SIDE), .flags = TCP_LIMIT,
     .unit = "pixels", .doc = "Height of the picture."},
    {"image", "background", TCP_SPECIAL, UNIT, .special = &tcp_special_background,
     .doc = "Colour behind the volume, [r,g,b] in sRGB 0..1, or \"transparent\" (png only)."},
    {"image", "format", TCP_NAME, AT(image.format), .names = formats, .doc = "Encoding of the picture."},
    {"image", "quality", TCP_INTEGER, AT(image.quality), RANGE(1, 100), .doc = "JPEG quality."},
    {"image", "subsampling", TCP_NAME, AT(image.subsampling), .names = subsamplings,
     .doc = "JPEG chroma subsampling; auto is 4:4:4 from quality 80, else 4:2:0."},
    {"image", "linearLight", TCP_BOOLEAN, AT(image.linear_light),
     .doc = "Composite in linear light and encode to sRGB; else in display space."},

    {"camera", "projection", TCP_NAME, AT(camera.projection), .names = projections, .doc = "Kind of projection."},
    {"camera", "position", TCP_VECTOR, AT(camera.position), 3, COORDINATES, .flags = TCP_FITTED, .unit = "LPS mm",
     .doc = "Where the eye is."},
    {"camera", "target", TCP_VECTOR, AT(camera.target), 3, COORDINATES, .flags = TCP_FITTED, .unit = "LPS mm",
     .doc = "What the eye looks at; differs from the position."},
    {"camera", "up", TCP_VECTOR, AT(camera.up), 3, COORDINATES, .flags = TCP_FITTED, .unit = "LPS",
     .doc = "Direction that is up in the picture; not parallel to the view."},
    {"camera", "fovY", TCP_NUMBER, AT(camera.fov_y_deg), RANGE(0, 180), .flags = TCP_ABOVE | TCP_BELOW,
     .unit = "degrees", .doc = "Perspective: angle the picture's height spans."},
    {"camera", "height", TCP_NUMBER, AT(camera.height_mm), RANGE(0, TCP_MAX_COORDINATE),
     .flags = TCP_ABOVE | TCP_FITTED, .unit = "mm", .doc = "Orthographic: length the picture's height spans."},

    {"transferFunction", "preset", TCP_SPECIAL, .flags = TCP_FITTED, .special = &tcp_special_preset,
     .doc = "Name of the preset the points come from."},
    {"transferFunction", "points", TCP_SPECIAL, .flags = TCP_FITTED, .special = &tcp_special_points,
     .doc = "Knots in ascending value; two at one value make a jump. All by opacity or all by extinction."},
    {"transferFunction", "unitDistance", TCP_NUMBER, AT(transfer_function.unit_distance_mm), RANGE(1e-9, 1e9),
     .flags = TCP_FITTED, .unit = "mm", .doc = "Length the opacity of a knot is for."},

    {"window", "center", TCP_NUMBER, AT(window.center), VALUES, .flags = TCP_FITTED, .unit = "value",
     .doc = "Value in the middle of the window."},
    {"window", "width", TCP_NUMBER, AT(window.width), RANGE(0, TCP_MAX_VALUE), .flags = TCP_ABOVE | TCP_FITTED,
     .unit = "value", .doc = "Values from black to white."},

    {"", "hideTable", TCP_BOOLEAN, AT(hide_table), .flags = TCP_FITTED,
     .doc = "Leave out tables, containers and padding around the body, where some were found; not in mode mpr."},
    {"", "classification", TCP_NAME, AT(classification), .names = tc_classification_names,
     .doc = "How colour and opacity are integrated between samples."},
    {"", "order", TCP_NAME, AT(order), .names = tc_order_names, .doc = "Order of compositing."},
    {"", "filter", TCP_NAME, AT(filter), .names = tc_filter_names, .doc = "Interpolation between voxels."},

    {"sampling", "step", TCP_NUMBER, AT(sampling.step), RANGE(1e-4, 1e6), .unit = "voxels of the smallest spacing",
     .doc = "Distance of samples along a ray."},
    {"sampling", "raysPerPixel", TCP_INTEGER, AT(sampling.rays_per_pixel), RANGE(1, TC_MAX_RAYS_PER_PIXEL),
     .flags = TCP_LIMIT,
     .doc = "Rays averaged in a pixel. In mode dvr they share its samples: with n rays, the step along each is n times as long."},
    {"sampling", "coherence", TCP_BOOLEAN, AT(sampling.coherence),
     .doc = "Share work between neighbouring rays where they agree."},
    {"sampling", "jitter", TCP_BOOLEAN, AT(sampling.jitter), .doc = "Shift each ray's first sample at random."},
    {"sampling", "prefilter", TCP_BOOLEAN, AT(sampling.prefilter),
     .doc = "Cubic filter: pass through the voxels (sharp) instead of smoothing them; takes four bytes a voxel."},
    {"sampling", "termination", TCP_NUMBER, AT(sampling.termination), UNIT, .unit = "transparency",
     .doc = "Early ray termination: a ray ends when its transparency is below this; 0 never ends it."},

    {"skipping", "mode", TCP_NAME, AT(skipping.mode), .names = skipping_modes, .doc = "Leap over empty blocks or not."},
    {"skipping", "block", TCP_INTEGER, AT(skipping.block), RANGE(0, 256), .unit = "voxels",
     .doc = "Side of a block; 0 lets the renderer choose."},

    {"shading", "model", TCP_NAME, AT(shading.model), .names = tc_shading_names, .doc = "Reflection model."},
    {"shading", "gradient", TCP_NAME, AT(shading.gradient), .names = tc_gradient_names,
     .doc = "Normals: of each cell, fastest; of central differences, smooth; of the cubic B-spline, smoothest."},
    {"shading", "ambient", TCP_NUMBER, AT(shading.ambient), UNIT, .doc = "Ambient light."},
    {"shading", "diffuse", TCP_NUMBER, AT(shading.diffuse), UNIT, .doc = "Diffuse reflection."},
    {"shading", "specular", TCP_NUMBER, AT(shading.specular), UNIT, .doc = "Specular reflection."},
    {"shading", "shininess", TCP_NUMBER, AT(shading.shininess), RANGE(0, 1024),
     .doc = "Exponent of the specular reflection."},
    {"shading", "light", TCP_SPECIAL, COORDINATES, .unit = "LPS", .special = &tcp_special_light,
     .doc = "\"camera\", or the direction to the light."},

    {"clip", "box", TCP_SPECIAL, COORDINATES, .unit = "LPS mm", .special = &tcp_special_box,
     .doc = "Two corners, least and greatest; what is outside is not drawn."},
    {"clip", "planes", TCP_SPECIAL, COORDINATES, .unit = "LPS mm", .special = &tcp_special_planes,
     .doc = "Up to six half spaces [nx,ny,nz,d]; drawn is where nx*x + ny*y + nz*z + d >= 0."},

    {"isosurface", "value", TCP_NUMBER, AT(isosurface.value), VALUES, .flags = TCP_FITTED, .unit = "value",
     .doc = "Value on the surface."},
    {"isosurface", "color", TCP_VECTOR, AT(isosurface.color), 3, UNIT, .unit = "sRGB", .doc = "Colour of the surface."},

    {"mesh", "surfaces", TCP_SPECIAL, .special = &tcp_special_surfaces,
     .doc = "Surfaces to draw, and nothing else. Empty: the surface at isosurface.value, or those of all visible labels."},
    {"mesh", "lights", TCP_SPECIAL, .special = &tcp_special_lights,
     .doc = "Lights on surfaces, added up, in place of shading.light."},
    {"mesh", "withVolume", TCP_BOOLEAN, AT(mesh.with_volume),
     .doc = "Modes dvr and mip draw the surfaces too, each where it is along the rays."},

    {"splat", "threshold", TCP_VECTOR, AT(splat.threshold), 2, VALUES, .flags = TCP_FITTED, .unit = "value",
     .doc = "Least and greatest value of the voxels drawn."},
    {"splat", "kernelRadius", TCP_NUMBER, AT(splat.kernel_radius), RANGE(0, 16), .flags = TCP_ABOVE, .unit = "voxels",
     .doc = "Radius of a voxel's footprint; from 0.9 on surfaces are closed."},
    {"splat", "attribute", TCP_TEXT, AT(splat.attribute), sizeof((tc_scene *)0)->splat.attribute, .flags = TCP_ASKED,
     .doc = "What gives the colour: \"value\", by the transfer function, or \"color\", isosurface.color, as when left "
            "out; or an attribute of a .vmd: label by its palette, normal by its components, others by the transfer "
            "function, their range stretched to the values'."},
    {"splat", "opaque", TCP_BOOLEAN, AT(splat.opaque),
     .doc = "Draw a solid, the nearest voxels win; else a cloud, with the transfer function's extinction."},
    {"splat", "culling", TCP_BOOLEAN, AT(splat.culling),
     .doc = "Leave out voxels that others hide; changes no bit of an opaque picture."},

    {"mpr", "orientation", TCP_NAME, AT(mpr.orientation), .names = orientations, .doc = "Plane of the slice."},
    {"mpr", "center", TCP_SPECIAL, AT(mpr.center), 3, COORDINATES, .unit = "LPS mm", .special = &tcp_special_mpr_center,
     .doc = "Point in the middle of the picture; the volume's centre when left out."},
    {"mpr", "normal", TCP_VECTOR, AT(mpr.normal), 3, COORDINATES, .unit = "LPS",
     .doc = "Oblique: normal of the plane, towards the viewer."},
    {"mpr", "up", TCP_VECTOR, AT(mpr.up), 3, COORDINATES, .unit = "LPS",
     .doc = "Oblique: direction that is up in the picture."},
    {"mpr", "thickness", TCP_NUMBER, AT(mpr.thickness_mm), RANGE(0, 1e6), .unit = "mm",
     .doc = "Thickness of the slab; 0 is one slice."},
    {"mpr", "projection", TCP_NAME, AT(mpr.projection), .names = tc_slab_projection_names,
     .doc = "How a slab becomes a slice."},
    {"mpr", "zoom", TCP_NUMBER, AT(mpr.zoom), RANGE(1e-3, 1e3), .doc = "1 shows the whole plane; 2 half of it."},

    {"labels", "volume", TCP_TEXT, AT(labels.volume), sizeof((tc_scene *)0)->labels.volume, .flags = TCP_ASKED,
     .doc = "Id of the volume of labels."},
    {"labels", "force", TCP_SPECIAL, .special = &tcp_special_force,
     .doc = "With volume: takes it even if it lies elsewhere, or has as many values as a scan. Not kept."},
    {"labels", "opacity", TCP_NUMBER, AT(labels.opacity), UNIT, .doc = "Opacity of all labels."},
    {"labels", "colors", TCP_SPECIAL, UNIT, .unit = "sRGB and opacity", .special = &tcp_special_label_colors,
     .doc = "Colour [r,g,b,a] by label number."},
    {"labels", "visible", TCP_SPECIAL, RANGE(0, 4294967295.0), .special = &tcp_special_visible,
     .doc = "Labels that are drawn; all when left out."},

    {"quality", "maxError", TCP_SPECIAL, AT(quality.max_error), UNIT, .flags = TCP_ABOVE | TCP_ASKED,
     .special = &tcp_special_quality, .doc = "Error a frame may have (RMS of colour 0..1), at the least cost."},
    {"quality", "maxMilliseconds", TCP_SPECIAL, AT(quality.max_ms), RANGE(0, 1e6), .flags = TCP_ABOVE | TCP_ASKED,
     .unit = "ms", .special = &tcp_special_quality, .doc = "Time a frame may take, at the least error."},

    {"errorMeter", "pixels", TCP_INTEGER, AT(error_meter.pixels), RANGE(0, 65536), .unit = "pixels",
     .doc = "Pixels of each final frame to compare; 0 is off."},
};
const size_t tcp_member_count = G_N_ELEMENTS(tcp_members);

#define KNOT(field) .offset = offsetof(tc_knot, field)
const tcp_member tcp_knot_members[4] = {
    {"", "value", TCP_NUMBER, KNOT(value), VALUES, .unit = "value", .doc = "The volume's value here."},
    {"", "color", TCP_VECTOR, KNOT(color), 3, UNIT, .unit = "sRGB", .doc = "Colour; linear between knots."},
    {"", "opacity", TCP_NUMBER, KNOT(amount), UNIT, .unit = "per unitDistance",
     .doc = "Opacity; linear between knots."},
    {"", "extinction", TCP_NUMBER, KNOT(amount), RANGE(0, TCP_MAX_VALUE), .unit = "1/mm",
     .doc = "Extinction; linear between knots."},
};

#define SURFACE(field) .offset = offsetof(tc_mesh_surface, field)
const tcp_member tcp_surface_members[13] = {
    {"", "value", TCP_NUMBER, SURFACE(value), VALUES, .unit = "value", .doc = "The volume's surface at this value."},
    {"", "label", TCP_INTEGER, SURFACE(label), RANGE(1, 2147483647),
     .doc = "The surface of this label of labels.volume."},
    {"", "mesh", TCP_TEXT, SURFACE(mesh), sizeof((tc_mesh_surface *)0)->mesh, .doc = "Id of a mesh."},
    {"", "plane", TCP_NAME, SURFACE(plane), .names = orientations,
     .doc = "The slice that mode mpr shows in this orientation, through mpr.center."},
    {"", "color", TCP_VECTOR, SURFACE(color), 3, UNIT, .unit = "sRGB",
     .doc = "Colour; when left out the label's, those of the mesh's vertices where it has any, or isosurface.color."},
    {"", "opacity", TCP_NUMBER, SURFACE(opacity), UNIT, .doc = "Opacity of each layer."},
    {"", "visible", TCP_BOOLEAN, SURFACE(visible), .doc = "Draw it."},
    {"", "twoSided", TCP_BOOLEAN, SURFACE(two_sided), .doc = "Draw back faces too."},
    {"", "model", TCP_NAME, SURFACE(model), .names = tc_shading_names, .doc = "Default: shading.model; the same holds for the members below."},
    {"", "ambient", TCP_NUMBER, SURFACE(ambient), UNIT, .doc = "Ambient light."},
    {"", "diffuse", TCP_NUMBER, SURFACE(diffuse), UNIT, .doc = "Diffuse reflection."},
    {"", "specular", TCP_NUMBER, SURFACE(specular), UNIT, .doc = "Specular reflection."},
    {"", "shininess", TCP_NUMBER, SURFACE(shininess), RANGE(0, 1024), .doc = "Exponent of the specular reflection."},
};

#define LIGHT(field) .offset = offsetof(tc_mesh_light, field)
const tcp_member tcp_light_members[3] = {
    {"", "direction", TCP_VECTOR, LIGHT(direction), 3, COORDINATES, .unit = "LPS",
     .doc = "To the light; when left out to the camera."},
    {"", "color", TCP_VECTOR, LIGHT(color), 3, UNIT, .unit = "sRGB", .doc = "White when left out."},
    {"", "intensity", TCP_NUMBER, LIGHT(intensity), RANGE(0, 16), .doc = "1 is as bright as shading.light."},
};
