/* Cleanup functions for g_autoptr(TYPE) and g_auto(TYPE), besides those of GLib. */
#ifndef TC_TEST_SCOPED_H
#define TC_TEST_SCOPED_H

#include <cjson/cJSON.h>
#include <glib.h>

#include "renderer/base/pool.h"
#include "renderer/classify/preintegration.h"
#include "renderer/mesh/mesh.h"
#include "renderer/reference/reference.h"
#include "renderer/splat/vmd.h"
#include "renderer/tomocast.h"

G_DEFINE_AUTOPTR_CLEANUP_FUNC(cJSON, cJSON_Delete)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_mesh, tc_mesh_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_pool, tc_pool_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_reference, tc_reference_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_renderer, tc_renderer_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_table, tc_table_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_vmd, tc_vmd_free)
G_DEFINE_AUTOPTR_CLEANUP_FUNC(tc_volume, tc_volume_unref)
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(tc_frame, tc_frame_finish)
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(tc_scene, tc_scene_clear)

#endif
