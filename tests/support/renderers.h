/* One renderer of each kind available on this machine (the instruction sets of the cpu back end, and OpenGL), for tests
 * that run on all of them. A test program passes test_renderers_open and test_renderers_close to cmocka. */
#ifndef TC_TEST_RENDERERS_H
#define TC_TEST_RENDERERS_H

#include "renderer/tomocast.h"

enum { SCALAR, AVX2, AVX512, GL, RENDERERS };
extern const char *const test_names[RENDERERS];
extern tc_renderer *test_renderers[RENDERERS]; /* NULL: not available, which was printed */
extern tc_frame test_frames[RENDERERS];         /* the last picture of each */

#define EACH_RENDERER(i) for (int i = 0; i < RENDERERS; i++) if (test_renderers[i])
#define EACH_CPU(i) for (int i = 0; i < GL; i++) if (test_renderers[i])

int test_renderers_open(void **state); /* fails without the scalar renderer */
int test_renderers_close(void **state);

int test_widest(void); /* the widest instruction set available */

/* Draws, or fails the test. The frame stays valid until this renderer's next picture. request NULL: only want_linear.
 */
tc_frame *test_draw(int which, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
                    tc_explanation *plan);

/* Draws with a pause at every check of the back end. Fails the test unless the picture equals test_draw()'s and comes
 * from the same back end. Returns the number of pauses. */
int test_resumes(int which, tc_volume *volume, const tc_scene *scene);

/* The reference integrator's picture [4 * width * height] at a tolerance (0: the tightest); caller frees with g_free().
 */
float *test_reference(tc_volume *volume, const tc_scene *scene, double tolerance);

#endif
