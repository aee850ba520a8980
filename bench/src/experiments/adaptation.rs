//! Guides and weights while a comb passes and after it has left (AS16 Fig. 7, §4.3).
//!
//! How many guides a hair effectively follows is 1/Σw² of its weights. AS16 Eq. (3) to the letter lets sets only shrink; ours grow
//! back, and both are shown.

use super::heads::{adaptive, few};
use super::watch::{Watched, reference, steps_at, watch_each};
use super::words::{claim, higher, lower, verdict};
use crate::error::Error;
use crate::evidence::{Experiment, Findings, Place, Plot, Table, View, number, text};
use crate::runtime_bench::{Figure, Subject, situations};
use adaptive_runtime::{Runtime, RuntimeParams};
use io_formats::skinning_model::SkinningModel;
use std::collections::BTreeMap;

/// The experiment.
pub const EXPERIMENT: Experiment = Experiment {
    name: "adaptation",
    title: "Guides and weights as a comb passes and leaves",
    source: "AS16 §4.3, Fig. 7",
    run,
};

/// Seconds the scene goes on after its own end.
const AFTER_S: f64 = 1.5;
/// Before the comb is in the hair, while it is, and long after, s.
const MOMENTS: [f64; 3] = [0.1, 1.4, 4.2];
/// Guides whose weights are drawn.
const MOST_CURVES: usize = 6;

/// What pictures show at a moment.
struct Shot {
    guides: Vec<[f32; 3]>,
    guide_colors: Vec<[f32; 3]>,
    hair: Vec<[f32; 3]>,
    weights: Vec<[f32; 3]>,
    numbers: Vec<[f32; 3]>,
}

fn run(place: &dyn Place) -> Result<Findings, Error> {
    let (head, size) = few(place)?;
    let mut scene = head.world.scene.clone();
    scene.seconds += AFTER_S;
    let world = head.world.staged(scene, None)?;
    let subject = Subject { world: &world, ..adaptive(&head) };
    let against = reference(place, &subject, size.measured, 0, &[])?;
    let chosen = most_touched(&head.model, &against.run.reach);
    let at = steps_at(&world, &MOMENTS);
    let (mut shots, mut weights) = (Vec::new(), Vec::new());
    let ours = watch_each(place, &subject, &against, &[], |step, runtime| {
        if let Some(strand) = chosen {
            let middle = runtime.n_particles() / 2;
            weights.push((step as f64 * world.scene.step_s, runtime.weights(strand, middle).collect::<Vec<_>>()));
        }
        if at.contains(&step) {
            shots.push(shoot(runtime));
        }
    })?;
    let letter = Subject { params: RuntimeParams::paper(), ..subject };
    let letter = watch_each(place, &letter, &against, &[], |_, _| {})?;
    let figures = situations::recovery_of(&subject, &against.run, &ours.quality);
    let literal = situations::recovery_of(&subject, &against.run, &letter.quality);
    let mut out = Findings {
        paragraphs: vec![
            format!(
                "The comb of the salon passes through the hair and leaves it ({}). Pictures: guides, each with a colour of its own; hair \
                 in the colours of its guides, mixed by their weights at the middle of each strand; and hair by how many guides it \
                 effectively follows, red for one, over yellow, to blue for three and more.",
                subject.size()
            ),
            "Where teeth stand between guides, hair is left with those on its own side: fewer, and other ones from moment to moment. After the \
             comb has left, sets grow back, which AS16 Eq. (3) taken literally never lets them."
                .to_owned(),
        ],
        ..Findings::default()
    };
    for (k, (shot, t)) in shots.iter().zip(MOMENTS).enumerate() {
        let row = format!("adaptation-{k}");
        let parts = [
            ("guides", "guides", &shot.guides, &shot.guide_colors),
            ("weights", "weights, mixed colours of guides", &shot.hair, &shot.weights),
            ("numbers", "effective guides: red one, blue three", &shot.hair, &shot.numbers),
        ];
        for (name, caption, positions, colors) in parts {
            let view = View { world: &world, t, positions, colors: Some(colors), turn: 0.0 };
            out.pictures.push(place.draw(&format!("{row}-{name}"), &format!("{caption}, {t:.2} s"), &row, &view)?);
        }
    }
    let dt = world.scene.step_s;
    out.plots.push(guides_over_time(dt, &ours, &letter));
    out.plots.push(weights_over_time(&weights));
    out.tables.push(table(&figures, &literal));
    claims(&mut out, &figures, &literal);
    Ok(out)
}

/// The strand in reach for most steps of those that may follow three guides or more.
fn most_touched(model: &SkinningModel, reach: &[Vec<u32>]) -> Option<usize> {
    let mut touched = vec![0_u32; model.n_strands as usize];
    for &s in reach.iter().flatten() {
        touched[s as usize] += 1;
    }
    let may = |s: &usize| model.eligible_start[s + 1] - model.eligible_start[*s] >= 3;
    (0..touched.len()).filter(may).max_by_key(|&s| touched[s]).filter(|&s| touched[s] > 0)
}

/// A colour of its own for each guide: hues a golden section apart.
fn hue(guide: u16) -> [f32; 3] {
    const GOLDEN: f32 = 0.618_034;
    let h = (f32::from(guide) * GOLDEN).fract() * 6.0;
    let channel = |shift: f32| {
        let x = (h + shift).rem_euclid(6.0);
        (2.0 - (x - 3.0).abs()).clamp(0.0, 1.0).max(0.05)
    };
    [channel(3.0), channel(1.0), channel(5.0)]
}

/// Red for one guide, yellow for two, blue for three and more.
fn of_number(guides: f64) -> [f32; 3] {
    let x = (guides as f32 - 1.0).clamp(0.0, 2.0);
    if x < 1.0 {
        [0.8, 0.05 + 0.6 * x, 0.05]
    } else {
        [0.8 * (2.0 - x) + 0.05, 0.65 - 0.4 * (x - 1.0), 0.05 + 0.7 * (x - 1.0)]
    }
}

fn shoot(runtime: &Runtime) -> Shot {
    let (n, positions) = (runtime.n_particles(), runtime.positions());
    let strands = &runtime.model().guide_strands;
    let mixed = |s: usize| {
        runtime.weights(s, n / 2).fold([0.0; 3], |sum: [f32; 3], (guide, w)| {
            let color = hue(guide);
            std::array::from_fn(|c| sum[c] + w * color[c])
        })
    };
    Shot {
        guides: strands.iter().flat_map(|&s| positions[s as usize * n..(s as usize + 1) * n].to_vec()).collect(),
        guide_colors: (0..strands.len()).map(|g| hue(g as u16)).collect(),
        hair: positions.to_vec(),
        weights: (0..runtime.n_strands()).map(mixed).collect(),
        numbers: (0..runtime.n_strands()).map(|s| of_number(runtime.effective_guides(s))).collect(),
    }
}

fn guides_over_time(dt: f64, ours: &Watched, letter: &Watched) -> Plot {
    let curve = |way: &Watched, which: usize| {
        way.quality.effective.iter().enumerate().map(|(k, e)| [(k + 1) as f64 * dt, e[which]]).collect()
    };
    Plot {
        title: "Effective guides over time".to_owned(),
        x: "time, s".to_owned(),
        y: "1/Σw², mean".to_owned(),
        curves: vec![
            ("ours, hairs that the comb meets".to_owned(), curve(ours, 0)),
            ("ours, all hairs".to_owned(), curve(ours, 1)),
            ("AS16 to the letter, hairs that the comb meets".to_owned(), curve(letter, 0)),
        ],
        ..Plot::default()
    }
}

fn weights_over_time(weights: &[(f64, Vec<(u16, f32)>)]) -> Plot {
    let mut total: BTreeMap<u16, f32> = BTreeMap::new();
    weights.iter().flat_map(|(_, w)| w).for_each(|&(guide, w)| *total.entry(guide).or_default() += w);
    let mut guides: Vec<u16> = total.keys().copied().collect();
    guides.sort_by(|a, b| total[b].total_cmp(&total[a]));
    let of = |guide: u16| {
        let at = |w: &Vec<(u16, f32)>| w.iter().find(|(g, _)| *g == guide).map_or(0.0, |(_, w)| f64::from(*w));
        weights.iter().map(|(t, w)| [*t, at(w)]).collect()
    };
    Plot {
        title: "Weights of the guides of one hair that the comb meets, at its middle".to_owned(),
        x: "time, s".to_owned(),
        y: "weight".to_owned(),
        curves: guides.into_iter().take(MOST_CURVES).map(|g| (format!("guide {g}"), of(g))).collect(),
        ..Plot::default()
    }
}

fn value(of: &[Figure], name: &str) -> f64 {
    of.iter().find(|f| f.name == name).and_then(|f| f.value).unwrap_or(f64::NAN)
}

const ROWS: [(&str, &str); 6] = [
    ("guides_before", "before the comb"),
    ("guides_least", "least"),
    ("guides_when_left", "when the last hair is out of reach"),
    ("guides_at_end", "at the end"),
    ("guides_recovery_s", "back to 95 % after, s"),
    ("seconds_after_solid_left", "seconds watched after it had left"),
];

fn table(ours: &[Figure], literal: &[Figure]) -> Table {
    Table {
        title: "Effective guides of hairs that the comb meets".to_owned(),
        columns: ["", "ours", "AS16 to the letter"].map(str::to_owned).to_vec(),
        rows: ROWS
            .iter()
            .map(|(name, words)| vec![text(*words), number(value(ours, name), 2), number(value(literal, name), 2)])
            .collect(),
        note: "A dash where sets never came back.".to_owned(),
    }
}

fn claims(out: &mut Findings, ours: &[Figure], literal: &[Figure]) {
    let [before, least, end] = ["guides_before", "guides_least", "guides_at_end"].map(|name| value(ours, name));
    out.claims.push(claim(
        "AS16 §4.3, Fig. 7",
        "Sets of guides and their weights change during the simulation, as solids and motion ask for.",
        "shown in pictures",
        format!(
            "{before:.2} effective guides before the comb, {least:.2} while it is in the hair, {end:.2} at the end"
        ),
        verdict(&[least < 0.9 * before, end >= 0.95 * before]),
        &format!(
            "That sets come back is a departure from Eq. (3): to the letter {:.2} are left at the end.",
            value(literal, "guides_at_end")
        ),
    ));
    out.measures.push(higher("guides_at_end_over_before", "x", end / before, 0.03));
    out.measures.push(lower("guides_least_over_before", "x", least / before, 0.1));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_guides_have_colours_that_can_be_told_apart() {
        for g in 0..100 {
            let (a, b) = (hue(g), hue(g + 1));
            let apart: f32 = (0..3).map(|c| (a[c] - b[c]).abs()).sum();
            assert!(apart > 0.5 && a.iter().all(|x| (0.0..=1.0).contains(x)), "{g}: {a:?} {b:?}");
        }
    }

    #[test]
    fn the_hair_that_is_watched_is_the_one_most_in_reach_that_has_guides_to_choose_from() {
        let mut model = super::super::two_guides::model(&[0.0, 1.0, 2.0, 3.0], &[1, 2]);
        // Strands 0 and 3 follow two guides each: none may follow three.
        assert_eq!(most_touched(&model, &[vec![0, 3], vec![3]]), None);
        model.eligible_start = vec![0, 3, 3, 3, 6];
        assert_eq!(most_touched(&model, &[vec![0, 3], vec![3]]), Some(3));
        assert_eq!(most_touched(&model, &[]), None);
    }
}
