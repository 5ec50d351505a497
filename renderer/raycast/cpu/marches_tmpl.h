/* The marches of rays that cast through a volume, and their pieces, in the order that simd.h explains. Follows packet_tmpl.h. */
#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/cubic_tmpl.h"

#include "renderer/raycast/cpu/filter_tmpl.h"

#include "renderer/raycast/cpu/preintegration_tmpl.h"

#include "renderer/raycast/cpu/integrals_tmpl.h"

#include "renderer/raycast/cpu/subtable_tmpl.h"

#include "renderer/raycast/cpu/opacity_correction_tmpl.h"

#include "renderer/raycast/cpu/jitter_tmpl.h"

#include "renderer/raycast/cpu/subpixel_tmpl.h"

#include "renderer/raycast/cpu/segment_tmpl.h"

#include "renderer/raycast/cpu/shading_tmpl.h"

#include "renderer/raycast/cpu/gradient_tmpl.h"

#include "renderer/raycast/cpu/labels_tmpl.h"

#include "renderer/raycast/cpu/cover_tmpl.h"

#include "renderer/raycast/cpu/neighbourhood_tmpl.h"

#include "renderer/raycast/cpu/lit_tmpl.h"

#include "renderer/raycast/cpu/termination_tmpl.h"

#include "renderer/raycast/cpu/dvr_tmpl.h"

#include "renderer/raycast/cpu/back_tmpl.h"

#include "renderer/raycast/cpu/projection_tmpl.h"
