#include "renderer/raycast/cpu/kernels.h"

/* The kernel of the key's own voxel type, else the one of any type. Sanitizer builds have the latter alone: it contains all of the
 * code, and compiles fast. */
#ifdef TC_ONE_KERNEL
#define FIND(isa)                                                                                                     \
  tc_cpu_kernel tc_kernel_##isa(const tc_plan_key *key) { return tc_kernel_##isa##_any(key); }
#else
#define FIND(isa)                                                                                                     \
  tc_cpu_kernel tc_kernel_##isa(const tc_plan_key *key) {                                                             \
    tc_cpu_kernel kernel = NULL;                                                                                      \
    switch (key->voxel_type) {                                                                                        \
    case TC_U8: kernel = tc_kernel_##isa##_u8(key); break;                                                            \
    case TC_I8: kernel = tc_kernel_##isa##_i8(key); break;                                                            \
    case TC_U16: kernel = tc_kernel_##isa##_u16(key); break;                                                          \
    case TC_I16: kernel = tc_kernel_##isa##_i16(key); break;                                                          \
    case TC_F32: kernel = tc_kernel_##isa##_f32(key); break;                                                          \
    }                                                                                                                 \
    return kernel ? kernel : tc_kernel_##isa##_any(key);                                                              \
  }
#endif
FIND(scalar)
FIND(avx2)
FIND(avx512)
