/* Standardised uptake values: the factor by hand, and when there is none. */
#include "tests/support/test.h"

#include "renderer/import/helper/dicom_suv.h"

/* 70 kg, 350 MBq of fluorine 18, injected an hour before the scan. */
static const tc_dicom_suv usual = {.units = "BQML", .corrected = "NORM\\ATTN\\SCAT\\DECY", .decay = "START",
                                   .series_date = "20240229", .series_time = "113000.5", .acquisition_date = "20240229",
                                   .acquisition_time = "113001", .scan = "", .start = "", .start_time = "103000.5",
                                   .weight_kg = 70, .dose_bq = 350e6, .half_life_s = 6586.2};

/* 2^(3600 / 6586.2) = 1.46064... by another way than exp2(). */
static double decayed(double seconds) { return exp(log(2) * seconds / 6586.2); }

static void check(const tc_dicom_suv *s, double wanted) {
  const char *missing;
  const double factor = tc_dicom_suv_factor(s, &missing);
  if (!(fabs(factor - wanted) <= 1e-12 * wanted)) fail_msg("%.15g, expected %.15g (%s)", factor, wanted, missing);
}

TEST(factors) {
  const double plain = 70000 / 350e6;
  tc_dicom_suv s = usual;
  check(&s, plain * decayed(3600));
  s.start = "20240228103000.50"; /* a day and an hour: the date counts where there is one */
  check(&s, plain * decayed(86400 + 3600));
  s.series_date = s.acquisition_date = "20240301"; /* over the leap day */
  check(&s, plain * decayed(2 * 86400 + 3600));
  s = usual;
  s.series_time = "001500";
  s.acquisition_time = "001501";
  s.start_time = "2345"; /* before midnight */
  check(&s, plain * decayed(1800));
  s = usual;
  s.series_time = "2000"; /* processed in the evening: GE says when it was scanned */
  s.scan = "20240229113000.50";
  check(&s, plain * decayed(3600));
  s = usual;
  s.decay = "ADMIN";
  check(&s, plain);
  s.units = "GML";
  check(&s, 1);
  s.units = "CNTS";
  s.philips = 0.0125;
  check(&s, 0.0125);
}

TEST(refusals) {
  tc_dicom_suv bad[11];
  const char *missing;
  for (int i = 0; i < 11; i++) bad[i] = usual;
  bad[0].units = "PROPCPS";
  bad[1].corrected = "NORM\\ATTN";
  bad[2].decay = "NONE";
  bad[3].weight_kg = 0;
  bad[4].dose_bq = NAN;
  bad[5].half_life_s = -1;
  bad[6].series_time = "2000"; /* after the acquisition */
  bad[7].start_time = "";
  bad[8].series_date = "2024";
  bad[9].start = "20240301103000"; /* after the scan */
  bad[10].start_time = "993000";
  for (int i = 0; i < 11; i++) {
    if (tc_dicom_suv_factor(&bad[i], &missing) != 0) fail_msg("case %d has a factor", i);
    assert_true(*missing);
  }
}

TESTS(NULL, NULL)
