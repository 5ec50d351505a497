/* Standardised uptake values of PET by body weight: the factor from a file's value to SUV. After the vendor-neutral
 * pseudo-code of QIBA's FDG-PET/CT profile (SUVbw, "happy path"): values corrected for attenuation and decay, decay
 * counted to the start of the scan (or to the injection). Plain numbers, no DICOM library. */
#ifndef TC_IMPORT_DICOM_SUV_H
#define TC_IMPORT_DICOM_SUV_H

#ifdef __cplusplus
extern "C" {
#endif

/* Values of the header; texts are never NULL, missing numbers are 0. */
typedef struct tc_dicom_suv {
  const char *units, *corrected, *decay; /* (0054,1001), (0028,0051), (0054,1102) */
  const char *series_date, *series_time, *acquisition_date, *acquisition_time;
  const char *scan;                 /* start of the scan as GE writes it, (0009,100d), or "" */
  const char *start, *start_time;   /* injection: date and time (0018,1078), time alone (0018,1072) */
  double weight_kg, dose_bq, half_life_s;
  double philips; /* Philips' factor for counts, (7053,1000) */
} tc_dicom_suv;

/* Returns the factor, or 0 with the reason in *missing (static). */
double tc_dicom_suv_factor(const tc_dicom_suv *suv, const char **missing);

#ifdef __cplusplus
}
#endif
#endif
