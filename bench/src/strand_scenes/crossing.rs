//! One hair pulled off another (MS08 Fig. 10c): stiction drags the other hair along, then lets go all at once.
//!
//! A hair hangs from its root; another, clamped at both ends and level, lies against it and is pulled away sideways. The
//! links between them hold at any force until they are longer than the separation threshold, so that the distance of the
//! two hairs grows slowly while they stick and jumps when the last link breaks.

use super::shape::largest_strain;
use super::{Film, Stage, ease, straight_strand};
use crate::error::Error;
use collision::segment_pair::closest_points;
use nalgebra::{Isometry3, Translation3, Vector3};
use serde::Serialize;
use strand_sim::interaction::StictionParams;
use strand_sim::{Drive, InteractionParams, Material, StepParams};

/// Particles of both hairs.
const N: usize = 31;

/// Step, s.
const DT: f64 = 0.002;

/// What the two hairs did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CrossingFigures {
    /// Links held before the pull.
    pub links_before: usize,
    /// Farthest that the hanging hair's middle was dragged from where it hung, cm.
    pub dragged_cm: f64,
    /// Farthest that it was dragged out of where it hung the other way, cm.
    pub pushed_cm: f64,
    /// When the last link broke, s after the pull began; none without links.
    pub broke_s: Option<f64>,
    /// Distance of the hairs in the step before the last link broke, cm.
    pub distance_before_cm: f64,
    /// Distance of the hairs a twentieth of a second later, cm.
    pub distance_after_cm: f64,
    /// Speed at which the hairs separated in that twentieth of a second, over the speed of the pull.
    pub speed_ratio: f64,
    /// Largest strain of any segment at any time.
    pub largest_strain: f64,
    /// Pairs of segments that crossed.
    pub passes: usize,
}

/// Pulls one hair off another at `speed_cm_per_s`, with the given stiction.
///
/// # Errors
/// Hairs that cannot be simulated.
pub fn pull_across(
    material: Material,
    stiction: StictionParams,
    speed_cm_per_s: f64,
) -> Result<(CrossingFigures, Film), Error> {
    const SETTLE_S: f64 = 0.6;
    const PULL_CM: f64 = 5.0;
    const AFTER_S: f64 = 0.05;
    const AWAY_CM: f64 = 1.0;
    const PICTURES: usize = 8;
    let length = 12.0;
    let touch = 0.9 * stiction.rest_cm;
    let mut rest = straight_strand(Vector3::zeros(), -Vector3::y(), length, N);
    rest.extend(straight_strand(Vector3::new(AWAY_CM + touch, -8.0, -5.0), Vector3::z(), 10.0, N));
    let interaction = InteractionParams { stiction, ..InteractionParams::dry() };
    let material = Material { air_drag_per_s: 4.0, ..material };
    let params = StepParams::standard();
    let mut stage = Stage::new(&rest, N, material, params, Some(interaction))?;

    // Clear of each other while the level hair takes its sag.
    let pulled = |x: f64| Isometry3::from(Translation3::new(x - AWAY_CM, 0.0, 0.0));
    let aside = |t: f64| pulled(AWAY_CM * (1.0 - ease(t, 0.7 * SETTLE_S)));
    let drive =
        |before: Isometry3<f64>, after: Isometry3<f64>| Drive { strand: 1, particles: (N - 2, N - 1), before, after };
    let mut at = aside(0.0);
    let mut figures = CrossingFigures {
        links_before: 0,
        dragged_cm: 0.0,
        pushed_cm: 0.0,
        broke_s: None,
        distance_before_cm: 0.0,
        distance_after_cm: 0.0,
        speed_ratio: 0.0,
        largest_strain: 0.0,
        passes: 0,
    };
    let n_settle = (SETTLE_S / DT).round() as usize;
    let n_pull = (PULL_CM / speed_cm_per_s / DT).round() as usize;
    let mut before = stage.positions();
    let mut hung = before[2 * N / 3];
    let mut distances = Vec::with_capacity(n_pull);
    for step in 0..n_settle + n_pull {
        let t = DT * (step + 1) as f64;
        let next = if step < n_settle { aside(t) } else { pulled(speed_cm_per_s * (t - SETTLE_S)) };
        stage.step(DT, &[Isometry3::identity(), next], &[drive(at, next)]);
        at = next;
        let now = stage.positions();
        figures.passes += stage.passes_since(&before);
        figures.largest_strain = figures.largest_strain.max(largest_strain(&now, &rest, N));
        if step + 1 == n_settle {
            figures.links_before = stage.links().links().len();
            hung = now[2 * N / 3];
            stage.shoot();
        }
        if step >= n_settle {
            let dragged = now[2 * N / 3].x - hung.x;
            figures.dragged_cm = figures.dragged_cm.max(dragged);
            figures.pushed_cm = figures.pushed_cm.max(-dragged);
            distances.push(distance(&now));
            if !stage.links().links().is_empty() {
                figures.broke_s = Some(t + DT - SETTLE_S);
            }
            if (step + 1 - n_settle).is_multiple_of(n_pull.div_ceil(PICTURES - 1)) || step + 1 == n_settle + n_pull {
                stage.shoot();
            }
        }
        before = now;
    }
    // Links held to the end have not broken at all.
    if let Some(broke) = figures.broke_s.filter(|b| *b < DT * n_pull as f64 - AFTER_S) {
        let k = ((broke / DT).round() as usize).saturating_sub(1);
        figures.distance_before_cm = distances[k.saturating_sub(1)];
        figures.distance_after_cm = distances[(k + (AFTER_S / DT) as usize).min(distances.len() - 1)];
        figures.speed_ratio = (figures.distance_after_cm - figures.distance_before_cm) / AFTER_S / speed_cm_per_s;
    }
    Ok((figures, stage.into_film()))
}

/// Distance of the first strand from the second, cm.
fn distance(positions: &[Vector3<f64>]) -> f64 {
    let (a, b) = positions.split_at(N);
    let to_b = |u: &[Vector3<f64>]| {
        b.windows(2).map(|v| closest_points(&[u[0], u[1]], &[v[0], v[1]]).distance2).fold(f64::INFINITY, f64::min)
    };
    a.windows(2).map(to_b).fold(f64::INFINITY, f64::min).sqrt()
}
