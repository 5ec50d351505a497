/* Which EGL display, which context. See device.h. */
#include "renderer/gl/device.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <link.h>
#include <pthread.h>
#include <string.h>

struct tc_gl_context {
  EGLDisplay display;
  EGLContext context;
  tc_gl_report report;
};

/* eglGetPlatformDisplay() returns one display per device, and eglTerminate() ends it for all its users: hence the
 * reference counts. */
#define MAX_DISPLAYS 32
static struct {
  EGLDisplay display;
  unsigned users;
} displays[MAX_DISPLAYS];
static pthread_mutex_t displays_lock = PTHREAD_MUTEX_INITIALIZER;

/* Entry points are looked up by hand: libepoxy aborts on a missing one, and resolves no EGL 1.5 name before a
 * display is initialised. */
static PFNEGLGETPLATFORMDISPLAYEXTPROC get_platform_display;
static PFNEGLQUERYDEVICESEXTPROC query_devices;
static PFNEGLQUERYDEVICESTRINGEXTPROC query_device_string;
static pthread_once_t entry_points_once = PTHREAD_ONCE_INIT;

/* True if `name` is one of the space-separated words of `list` (NULL is an empty list). */
static bool has_word(const char *list, const char *name) {
  size_t length = strlen(name);
  for (const char *at = list; at && (at = strstr(at, name)); at += length)
    if ((at == list || at[-1] == ' ') && (at[length] == ' ' || at[length] == 0)) return true;
  return false;
}

static void find_entry_points(void) {
  const char *client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  if (!has_word(client, "EGL_EXT_platform_base")) return;
  get_platform_display = (PFNEGLGETPLATFORMDISPLAYEXTPROC)eglGetProcAddress("eglGetPlatformDisplayEXT");
  bool device_platform = has_word(client, "EGL_EXT_platform_device");
  if (device_platform && (has_word(client, "EGL_EXT_device_enumeration") || has_word(client, "EGL_EXT_device_base"))) {
    query_devices = (PFNEGLQUERYDEVICESEXTPROC)eglGetProcAddress("eglQueryDevicesEXT");
    query_device_string = (PFNEGLQUERYDEVICESTRINGEXTPROC)eglGetProcAddress("eglQueryDeviceStringEXT");
  }
}

#define MAX_DRIVERS 8
typedef struct drivers {
  int count;
  char paths[MAX_DRIVERS][512];
} drivers;

static int note_driver(struct dl_phdr_info *object, size_t size, void *user) {
  drivers *found = user;
  if (g_str_has_suffix(object->dlpi_name, "_dri.so") && found->count < MAX_DRIVERS)
    g_strlcpy(found->paths[found->count++], object->dlpi_name, sizeof found->paths[0]);
  return 0;
}

/* Keeps Mesa's drivers loaded after the last display ends. A driver leaks a few tables per load of its library (on
 * AMD processors, the topology of the caches), and libEGL unloads it with the last display: a program that opens
 * displays repeatedly would leak, and pay for loading, each time. */
static void keep_drivers(void) {
  drivers found = {0};
  dl_iterate_phdr(note_driver, &found);
  for (int i = 0; i < found.count; i++) { /* not in the callback above, which holds a lock of the loader */
    void *driver = dlopen(found.paths[i], RTLD_LAZY | RTLD_NOLOAD | RTLD_NODELETE);
    if (driver) dlclose(driver);
  }
}

/* Initialises the display, or adds a user to it. */
static bool acquire_display(EGLDisplay display) {
  bool good = false;
  pthread_mutex_lock(&displays_lock);
  int slot = -1;
  for (int i = 0; i < MAX_DISPLAYS; i++) {
    if (displays[i].users > 0 && displays[i].display == display) {
      slot = i;
      break;
    }
    if (displays[i].users == 0 && slot < 0) slot = i;
  }
  if (slot >= 0 && (displays[slot].users > 0 || eglInitialize(display, NULL, NULL))) {
    if (displays[slot].users == 0) keep_drivers();
    displays[slot].display = display;
    displays[slot].users++;
    good = true;
  }
  pthread_mutex_unlock(&displays_lock);
  return good;
}

static void release_display(EGLDisplay display) {
  pthread_mutex_lock(&displays_lock);
  for (int i = 0; i < MAX_DISPLAYS; i++)
    if (displays[i].users > 0 && displays[i].display == display && --displays[i].users == 0) eglTerminate(display);
  pthread_mutex_unlock(&displays_lock);
}

/* A context without a surface on an initialised display: no config where the driver allows it, else any. */
static EGLContext create_context(EGLDisplay display) {
  const char *extensions = eglQueryString(display, EGL_EXTENSIONS);
  if (!has_word(extensions, "EGL_KHR_surfaceless_context") || !has_word(extensions, "EGL_KHR_create_context"))
    return EGL_NO_CONTEXT;
  EGLConfig config = EGL_NO_CONFIG_KHR;
  if (!has_word(extensions, "EGL_KHR_no_config_context")) {
    const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_NONE};
    EGLint count = 0;
    if (!eglChooseConfig(display, wanted, &config, 1, &count) || count < 1) return EGL_NO_CONTEXT;
  }
  /* With robustness, a hung GPU is reported (tc_gl_check) instead of giving black pictures; not every driver
   * supports it. */
  const EGLint robust[] = {EGL_CONTEXT_MAJOR_VERSION_KHR,
                           4,
                           EGL_CONTEXT_MINOR_VERSION_KHR,
                           5,
                           EGL_CONTEXT_OPENGL_PROFILE_MASK_KHR,
                           EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT_KHR,
                           EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY_KHR,
                           EGL_LOSE_CONTEXT_ON_RESET_KHR,
                           EGL_NONE};
  const EGLint plain[] = {EGL_CONTEXT_MAJOR_VERSION_KHR,
                          4,
                          EGL_CONTEXT_MINOR_VERSION_KHR,
                          5,
                          EGL_CONTEXT_OPENGL_PROFILE_MASK_KHR,
                          EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT_KHR,
                          EGL_NONE};
  EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, robust);
  return context != EGL_NO_CONTEXT ? context : eglCreateContext(display, config, EGL_NO_CONTEXT, plain);
}

/* Software is recognised by name too, because the surfaceless platform does not tell which device it uses. */
static bool is_software_name(const char *renderer) {
  static const char *const names[] = {"llvmpipe", "softpipe", "swrast", "Software Rasterizer", "SWR", "SwiftShader"};
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    if (strstr(renderer, names[i])) return true;
  return false;
}

/* Needs the context to be current. */
static void fill_report(tc_gl_report *report, const char *platform) {
  GLint side = 0;
  GLint64 ssbo = 0;
  GLint bits = 0;
  glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &side);
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &ssbo);
  glGetQueryiv(GL_TIMESTAMP, GL_QUERY_COUNTER_BITS, &bits);
  g_strlcpy(report->platform, platform, sizeof report->platform);
  g_strlcpy(report->vendor, (const char *)glGetString(GL_VENDOR), sizeof report->vendor);
  g_strlcpy(report->renderer, (const char *)glGetString(GL_RENDERER), sizeof report->renderer);
  g_strlcpy(report->version, (const char *)glGetString(GL_VERSION), sizeof report->version);
  report->max_3d_side = side;
  report->max_ssbo_bytes = ssbo;
  report->timestamp_bits = bits;
  report->hardware = !is_software_name(report->renderer);
}

/* Opens one native display (a device, or NULL for surfaceless) and fills *context, current on this thread. */
static bool open_display(EGLenum platform, void *native, tc_gl_context *context) {
  EGLDisplay display = get_platform_display(platform, native, NULL);
  if (display == EGL_NO_DISPLAY || !acquire_display(display)) return false;
  EGLContext made = EGL_NO_CONTEXT;
  if (eglBindAPI(EGL_OPENGL_API)) made = create_context(display);
  if (made == EGL_NO_CONTEXT || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, made)) {
    if (made != EGL_NO_CONTEXT) eglDestroyContext(display, made);
    release_display(display);
    return false;
  }
  context->display = display;
  context->context = made;
  fill_report(&context->report, platform == EGL_PLATFORM_DEVICE_EXT ? "device" : "surfaceless");
  return true;
}

static void close_display(tc_gl_context *context) {
  if (eglGetCurrentContext() == context->context)
    eglMakeCurrent(context->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(context->display, context->context);
  release_display(context->display);
}

/* Fills devices[MAX_DISPLAYS] with those that do not report to be software; -1 if EGL cannot list devices. */
static int list_hardware(EGLDeviceEXT *devices) {
  EGLDeviceEXT all[MAX_DISPLAYS];
  EGLint count = 0;
  int kept = 0;
  if (!query_devices || !query_device_string || !query_devices(MAX_DISPLAYS, all, &count)) return -1;
  for (EGLint i = 0; i < count; i++)
    if (!has_word(query_device_string(all[i], EGL_EXTENSIONS), "EGL_MESA_device_software")) devices[kept++] = all[i];
  return kept;
}

int tc_gl_count_hardware(void) {
  EGLDeviceEXT devices[MAX_DISPLAYS];
  pthread_once(&entry_points_once, find_entry_points);
  return list_hardware(devices);
}

/* The first hardware device that gives a context. */
static bool open_hardware(tc_gl_context *context, int *n_devices) {
  EGLDeviceEXT devices[MAX_DISPLAYS];
  *n_devices = list_hardware(devices);
  for (int i = 0; i < *n_devices; i++) {
    if (!open_display(EGL_PLATFORM_DEVICE_EXT, devices[i], context)) continue;
    if (context->report.hardware) return true;
    close_display(context);
  }
  return false;
}

tc_gl_context *tc_gl_context_new(GError **error) {
  pthread_once(&entry_points_once, find_entry_points);
  if (!get_platform_display) {
    tc_set_error(
        error, TC_ERROR_UNSUPPORTED, NULL,
        "gl: EGL has no EGL_EXT_platform_base; install a driver with EGL (Debian: libegl-mesa0) or use --backend cpu");
    return NULL;
  }
  tc_gl_context *context = g_new0(tc_gl_context, 1);
  int n_devices = 0;
  bool open = open_hardware(context, &n_devices);
  if (!open && has_word(eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS), "EGL_MESA_platform_surfaceless"))
    open = open_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, context);
  if (!open) {
    g_free(context);
    tc_set_error(
        error, TC_ERROR_UNSUPPORTED, NULL,
        "gl: none of %d hardware EGL device(s) nor the surfaceless platform gives OpenGL 4.5 core; use --backend cpu",
        MAX(n_devices, 0));
    return NULL;
  }
  return context;
}

void tc_gl_context_free(tc_gl_context *context) {
  if (!context) return;
  close_display(context);
  g_free(context);
}

bool tc_gl_context_use(tc_gl_context *context, GError **error) {
  if (eglGetCurrentContext() == context->context) return true;
  if (eglBindAPI(EGL_OPENGL_API) && eglMakeCurrent(context->display, EGL_NO_SURFACE, EGL_NO_SURFACE, context->context))
    return true;
  tc_set_error(error, TC_ERROR_INTERNAL, NULL,
               "gl: the context cannot be made current here (EGL error 0x%x); "
               "it belongs to the thread that created the renderer",
               (unsigned)eglGetError());
  return false;
}

void tc_gl_context_release(void) { eglReleaseThread(); }

const tc_gl_report *tc_gl_context_about(const tc_gl_context *context) { return &context->report; }

bool tc_gl_report_read(tc_gl_report *report, GError **error) {
  EGLDisplay display = eglGetCurrentDisplay();
  EGLContext before = eglGetCurrentContext();
  EGLSurface draw = eglGetCurrentSurface(EGL_DRAW), read = eglGetCurrentSurface(EGL_READ);
  tc_gl_context *context = tc_gl_context_new(error);
  if (context) *report = context->report;
  tc_gl_context_free(context);
  if (before != EGL_NO_CONTEXT) eglMakeCurrent(display, draw, read, before);
  return context != NULL;
}

static const char *error_name(GLenum code) {
  switch (code) {
  case GL_INVALID_ENUM: return "invalid enum";
  case GL_INVALID_VALUE: return "invalid value";
  case GL_INVALID_OPERATION: return "invalid operation";
  case GL_INVALID_FRAMEBUFFER_OPERATION: return "invalid framebuffer operation";
  case GL_OUT_OF_MEMORY: return "out of memory";
  case GL_CONTEXT_LOST: return "context lost";
  default: return "unknown error";
  }
}

void tc_gl_forget_errors(void) {
  /* Bounded, because a lost context returns GL_CONTEXT_LOST for ever. */
  for (int i = 0; i < 64 && glGetError() != GL_NO_ERROR; i++) {
  }
}

bool tc_gl_check(const char *what, GError **error) {
  GLenum code = glGetError();
  GLenum reset = glGetGraphicsResetStatus();
  if (reset != GL_NO_ERROR || code == GL_CONTEXT_LOST) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL,
                 "gl: %s: the GPU was reset and the context is lost; restart the daemon", what);
    return false;
  }
  if (code == GL_NO_ERROR) return true;
  tc_gl_forget_errors();
  tc_set_error(error, code == GL_OUT_OF_MEMORY ? TC_ERROR_MEMORY : TC_ERROR_INTERNAL, NULL, "gl: %s: %s (0x%x)", what,
               error_name(code), code);
  return false;
}
