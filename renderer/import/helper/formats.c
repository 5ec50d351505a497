/* Chooses among all formats but DICOM and MINC, by content first and by name second. */
#include <string.h>

#include "renderer/import/helper/format.h"

/* Volume formats, then mesh formats. Any text that begins like OBJ is OBJ, so OBJ is tried last. */
static const tc_format *const formats[] = {&tc_format_nifti, &tc_format_nrrd, &tc_format_metaimage, &tc_format_mgh,
                                           &tc_format_parrec, &tc_format_vmd, &tc_format_ply, &tc_format_stl, &tc_format_obj};
enum { FIRST_MESH = 6 };

static bool has_suffix(const char *name, const char *suffixes) {
  char *lower = g_ascii_strdown(name, -1), **list = g_strsplit(suffixes, "|", -1);
  bool found = false;
  for (char **s = list; *s; s++)
    if (g_str_has_suffix(lower, *s)) found = true;
  g_strfreev(list);
  g_free(lower);
  return found;
}

bool tc_formats_know(const tc_input *input) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  if (!tc_input_head(input, head, sizeof head, &size, NULL)) return false;
  for (int i = 0; i < FIRST_MESH; i++)
    if (formats[i]->probe(head, size)) return true;
  return false;
}

static const tc_format *const *recognise(const tc_input *input, const uint8_t *head, size_t size) {
  const tc_format *const *end = formats + G_N_ELEMENTS(formats);
  for (const tc_format *const *f = formats; f < end; f++)
    if ((*f)->probe(head, size) || (*f == &tc_format_stl && tc_stl_fits(head, size, input->size))) return f;
  for (const tc_format *const *f = formats; f < end; f++)
    if (has_suffix(input->name, (*f)->suffixes)) return f;
  return NULL;
}

/* Error for a volume where a mesh is expected, or the reverse. */
static bool refuse_kind(const tc_format *format, bool wants_mesh, GError **error) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL,
               wants_mesh ? "the file is %s, a volume: open it as a volume" : "the file is %s, a mesh: open it as a mesh",
               format->name);
  return false;
}

/* The input is the data file of a pair, the .img of NIfTI or the .rec of PAR/REC: reads its header instead. */
static bool use_header_beside(tc_input *input, GError **error) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  tc_input header;
  const bool rec = has_suffix(input->name, ".rec");
  if (!input->open || (!rec && !has_suffix(input->name, ".img|.img.gz"))) return true;
  char *name = g_strdup(input->name), *dot = g_strrstr(name, ".") - (has_suffix(name, ".gz") ? 4 : 0);
  memcpy(dot, rec ? dot[1] == 'r' ? ".par" : ".PAR" : ".hdr", 5);
  bool found = tc_input_open_sibling(input, name, true, &header, error);
  g_free(name);
  if (!found) return !*error;
  if (!tc_input_head(&header, head, sizeof head, &size, error)) {
    tc_input_close(&header);
    return false;
  }
  if (!(rec ? tc_format_parrec : tc_format_nifti).probe(head, size)) {
    tc_input_close(&header);
    return true;
  }
  header.open = input->open;
  header.open_user = input->open_user;
  tc_input_close(input);
  *input = header;
  return true;
}

/* Error for an unsupported file, recognised by its first bytes, with a way to convert it. */
static bool refuse(const uint8_t *head, size_t size, bool mesh, GError **error) {
#define AT(at, magic) at, sizeof magic - 1, magic
  static const struct {
    size_t at, n;
    const char *magic, *what;
  } others[] = {
      {AT(257, "ustar"), "a tar archive: unpack it and open the folder or the file in it"},
      {AT(0, "CDF\1"), "NetCDF, such as MINC 1: convert it to MINC 2 (mincconvert -2) or NIfTI (mnc2nii)"},
      {AT(0, "\xff\xd8\xff"), "a JPEG picture, which loses values: save the stack as TIFF or PNG"},
      {AT(4, "jP  \r\n"), "JPEG 2000: save the stack as TIFF or PNG"},
      {AT(0, "%PDF"), "a PDF: it holds no volume, save its pictures as PNG"},
      {AT(0, "MATLAB 5.0"), "a MATLAB file: save the array as NIfTI (niftiwrite)"},
      {AT(0, "# vtk DataFile"), "VTK: save it as MetaImage or NRRD (ParaView, 3D Slicer)"},
      {AT(0, "<?xml"), "XML, such as VTK's: save it as MetaImage or NRRD (ParaView, 3D Slicer)"},
  };
#undef AT
  for (size_t i = 0; i < G_N_ELEMENTS(others); i++) {
    if (size < others[i].at + others[i].n || memcmp(head + others[i].at, others[i].magic, others[i].n) != 0) continue;
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "%s", others[i].what);
    return false;
  }
  tc_set_error(error, TC_ERROR_FORMAT, NULL,
               mesh ? "unknown kind of file: meshes are read from OBJ, PLY and STL"
                    : "unknown kind of file: NIfTI, Analyze, NRRD, MetaImage, MGH, PAR/REC, MINC, VMD and DICOM are read");
  return false;
}

bool tc_formats_read(tc_input *input, const char *choice, const tc_order *order, GError **error) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  tc_order own = *order;
  if (!use_header_beside(input, error) || !tc_input_head(input, head, sizeof head, &size, error)) return false;
  if (input->size == 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "the file is empty");
    return false;
  }
  const tc_format *const *found = recognise(input, head, size);
  const tc_helper other = tc_helper_of(head, size);
  if (!found && !order->mesh && input->packing != TC_ENCODING_RAW && other != TC_HELPER_FORMATS)
    return tc_order_elsewhere(other, error);
  if (!found) return refuse(head, size, order->mesh, error);
  if ((found >= formats + FIRST_MESH) != order->mesh) return refuse_kind(*found, order->mesh, error);
  return tc_choice_volume(choice, (*found)->name, &own.volume, error) && (*found)->read(input, &own, error);
}
