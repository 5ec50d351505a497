// The page of a report; its parts come from report_scenes.js and report_objects.js.
'use strict';

const SWEPT_QUICK =
  'Swept: every classification at steps of 2 to 0.25 voxels on the cpu, preintegrated2 from 4, and pre-integrated on gl; ' +
  'at a step of 1, pre-integrated on the cpu, one other choice at a time; at 0.25, tables of 1024 entries a side. ' +
  'Without --quick much more is.';
const SWEPT =
  'Swept, on both back ends: every classification at steps of 4 to 0.125 voxels with 1 to 16 rays a pixel, all combined; ' +
  'and of the pre-integrated ones, at steps of 2, 1 and 0.5, one other choice at a time: order, filter, jitter, coherence ' +
  'of four rays, early ray termination, size and precision of the table; at 0.125, the largest table. Not combined: ' +
  'several of these.';

function foot() {
  return [
    html('h2', {}, 'How it was measured'),
    html(
      'p',
      {},
      'rms, 99.9th percentile and maximum are of premultiplied colour and opacity, 0 to 1, before the background and the ' +
        '8 bits of a picture; CIEDE2000 and SSIM of the picture as shown. Settings of one ray a pixel are compared with ' +
        "the ray through the pixel's centre, settings of more with the mean over the pixel's area (4 x 4 reference rays " +
        'for a random 16th of the pixels). Every batch of eight settings holds one anchor; times are scaled by it, so ' +
        'that a machine that slows down does not bend the front. report.json holds every figure, report.csv those of settings.',
    ),
    html('p', {}, about.quick ? SWEPT_QUICK : SWEPT),
    leftOut.length
      ? [
          html('h3', {}, 'Left out'),
          html(
            'ul',
            {},
            leftOut.map(({ why }) => html('li', {}, why)),
          ),
        ]
      : null,
  ];
}

document.body.append(
  ...[
    head(),
    overview(),
    html('h2', {}, 'Cheapest setting under a bound'),
    html(
      'p',
      {},
      'The fastest of all measured settings whose error against the reference stays under the bound; colours and opacity ' +
        'count from 0 to 1. \u0394E is the mean CIEDE2000 of the picture as shown.',
    ),
    html('h3', {}, 'Root mean square under the bound'),
    cheapestTable('rms'),
    html('h3', {}, 'Every compared pixel under the bound'),
    cheapestTable('max'),
    html('h2', {}, 'Observed orders of convergence'),
    html(
      'p',
      {},
      'Slope of the error over the step, finest three octaves above single precision, cpu back end. The expected order ' +
        'holds where field and transfer function are smooth along a ray; what each scene does to it stands with the scene.',
    ),
    orders(),
    html('h2', {}, 'What single choices cost'),
    html(
      'p',
      {},
      'Pre-integrated, step of one voxel, cpu; one choice away from the usual. Each cell: rms, largest error, and time as ' +
        "a multiple of the usual's.",
    ),
    CHOICES.map(choiceTable),
    objectsSection(),
    gridsSection(),
    surfaceSection(),
    scenes.map(sceneSection),
    foot(),
  ]
    .flat(3)
    .filter(Boolean),
);
