//! What keeps single hairs out of a solid: guide interpolation alone, AS16's forces on guides, particles moved out one by one, and
//! the carried offset of this project (AS16 Fig. 5 and 8, §5.2, §7.2).

use super::heads::{adaptive, few};
use super::watch::{Reference, Row, Watched, reference, side_by_side, watch};
use super::words::{ALIKE_PCT, CLEAN_PCT, QUIET, VISIBLE_PCT, claim, lower, off_one, table, verdict};
use crate::error::Error;
use crate::evidence::{Experiment, Findings, Place, Plot};
use crate::runtime_bench::Subject;
use adaptive_runtime::{Correction, RuntimeParams};

/// The experiment.
pub const EXPERIMENT: Experiment =
    Experiment { name: "correction", title: "Correction schemes", source: "AS16 §5.2, §7.2, Fig. 5 and 8", run };

/// While the comb is in the hair, s.
const MOMENTS: [f64; 2] = [1.2, 1.9];
/// How much more an unsteady scheme flickers than ours.
const MORE: f64 = 1.5;

/// Ways of correction, with their names in words.
fn ways() -> [(&'static str, RuntimeParams); 4] {
    let with = |correction, two_way| {
        let mut params = RuntimeParams::adaptive();
        params.residual.correction = correction;
        params.two_way.enabled = two_way;
        params
    };
    [
        ("ours", with(Correction::Carried, true)),
        ("interpolation only", with(Correction::None, false)),
        ("forces on guides only, as AS16", with(Correction::None, true)),
        ("position-based, as Chai 2014", with(Correction::Position, false)),
    ]
}

fn run(place: &dyn Place) -> Result<Findings, Error> {
    let (head, size) = few(place)?;
    let subject = adaptive(&head);
    let against = reference(place, &subject, size.measured, size.reference, &MOMENTS)?;
    let mut found = Vec::new();
    for (name, params) in ways() {
        found.push((name, watch(place, &Subject { params, ..subject }, &against, &MOMENTS)?));
    }
    let named: Vec<(&str, &Watched)> = found.iter().map(|(name, way)| (*name, way)).collect();
    let mut out = Findings {
        paragraphs: vec![
            format!(
                "The comb of the salon ({}), with sets that adapt, and four ways to treat hair that its guides lead into a solid: \
                 nothing; AS16's two-way correction, where forces on hairs become forces on their guides; particles moved out one \
                 by one at the end of a step (Chai 2014); and ours, forces on guides together with an offset of each hair that is \
                 carried from step to step like a state of its own.",
                subject.size()
            ),
            "Flicker is the length of a particle's second difference over a step; the curves show its 99.9th percentile over all \
             particles of near hairs, where a hair that jumps cannot hide among many that do not. Hair that is inside the comb is drawn red."
                .to_owned(),
        ],
        tables: vec![table("Correction schemes, comb", &against, &named)],
        plots: vec![flicker_over_time(&against, &named)],
        ..Findings::default()
    };
    for (at, t) in MOMENTS.into_iter().enumerate() {
        let mut shown = vec![("full space", against.shots[at].as_slice())];
        shown.extend(named.iter().map(|(name, way)| (*name, way.shots[at].as_slice())));
        let row = format!("correction-{at}");
        out.pictures.extend(side_by_side(
            place,
            &head.world,
            Row { name: &row, t, n_strands: size.reference, marks: true },
            &shown,
        )?);
    }
    let way = |k: usize| named[k].1;
    claims(&mut out, &against, [way(0), way(1), way(2), way(3)]);
    let [_, p999] = way(0).flicker_over(&against);
    out.measures = vec![
        lower("inside_pct", "%", way(0).quality.measured.near_strands_inside_pct, 1.0),
        lower("flicker_p999_off_one", "x", off_one(p999), 0.5),
        lower("standoff_beyond_full_mm", "mm", way(0).standoff_mm(&against).abs(), 0.2),
    ];
    Ok(out)
}

fn flicker_over_time(against: &Reference, ways: &[(&str, &Watched)]) -> Plot {
    let mut curves = vec![("full space".to_owned(), against.flicker.clone())];
    curves.extend(ways.iter().map(|(name, way)| ((*name).to_owned(), way.flicker.clone())));
    Plot {
        title: "Flicker of near hairs over time, 99.9th percentile".to_owned(),
        x: "time, s".to_owned(),
        y: "second difference, mm".to_owned(),
        log_y: true,
        curves,
        ..Plot::default()
    }
}

fn claims(out: &mut Findings, against: &Reference, [ours, nothing, forces, position]: [&Watched; 4]) {
    let inside = |way: &Watched| way.quality.measured.near_strands_inside_pct;
    let p999 = |way: &Watched| way.flicker_over(against)[1];
    out.claims.push(claim(
        "AS16 §7.2, Fig. 8 (b)",
        "Interpolation from guides alone disregards collisions and lets hair into solids.",
        "shown in pictures",
        format!("{:.1} % of near hairs in reach inside", inside(nothing)),
        verdict(&[inside(nothing) >= VISIBLE_PCT]),
        "",
    ));
    out.claims.push(claim(
        "AS16 §5.2, §7.2, Fig. 8 (c)",
        "Two-way correction by forces on guides lets sparse guides resolve collisions with small features.",
        "shown in pictures",
        format!("{:.1} % inside with forces on guides only, {:.1} % without", inside(forces), inside(nothing)),
        verdict(&[inside(forces) <= CLEAN_PCT, inside(forces) <= 0.5 * inside(nothing)]),
        "Guides stand centimetres apart and a tooth is 2 mm thick: what pushes a hair aside on one side of a tooth pushes its neighbour \
         the other way, and a guide that both follow stays. That is why ours carries an offset for each hair as well.",
    ));
    out.highlights.push(format!(
        "Forces on guides alone, AS16's two-way correction, leave {:.1} % of near hairs inside the comb ({:.1} % without): what keeps hair \
         out here is an offset of each hair that is carried from step to step, which AS16 has not. Moving particles out one by one \
         flickers {:.1} times as much as full space, ours {:.1} times.",
        inside(forces),
        inside(nothing),
        p999(position),
        p999(ours)
    ));
    let error = ours.error_pct()[0];
    out.claims.push(claim(
        "AS16 §7.2, Fig. 8 (c)",
        "Corrected hair closely matches the full-space simulation.",
        "shown in pictures",
        format!("ours: error of near hairs {error:.2} % of length, {:.2} % inside", inside(ours)),
        verdict(&[error <= ALIKE_PCT, inside(ours) <= CLEAN_PCT]),
        "Ours is the two-way correction together with the carried one.",
    ));
    out.claims.push(claim(
        "AS16 §5.2, §7.2, Fig. 5 and 8 (d)",
        "Correcting positions one by one flickers, since it disregards hair dynamics and velocities over time.",
        "shown in a video",
        format!("99.9 % of second differences: {:.2} x full space's, ours {:.2} x", p999(position), p999(ours)),
        verdict(&[p999(position) >= QUIET, p999(position) >= MORE * p999(ours)]),
        "",
    ));
    out.claims.push(claim(
        "AS16 §7.2, Fig. 8 (d)",
        "Position-based correction is less natural than the two-way scheme.",
        "shown in pictures",
        format!(
            "error of near hairs {:.2} % of length, ours {error:.2} %; inside {:.1} %, ours {:.2} %",
            position.error_pct()[0],
            inside(position),
            inside(ours)
        ),
        verdict(&[position.error_pct()[0] > error, inside(position) > inside(ours)]),
        "",
    ));
}
