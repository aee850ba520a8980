//! A hair that gives way (MS08 Fig. 10a, b): its ends pushed together, or one of them twisted.
//!
//! Both ends are clamped along x and weightless, in air that takes up the swinging, so that what is seen is the spring
//! network's own answer to a slow load. The hair meets itself: repulsion and collisions are on, stiction is off, since a
//! hair that sticks to itself would hold a loop that elasticity alone does not.

use super::shape::{largest_strain, largest_turn, off_axis, writhe};
use super::{Film, Stage, ease, straight_strand};
use crate::error::Error;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;
use std::f64::consts::TAU;
use strand_sim::interaction::StictionParams;
use strand_sim::stiffness::{RodStiffness, SpringConstants, straight_stiffness};
use strand_sim::{Drive, InteractionParams, Material, StepParams};

/// Air drag that takes up the slowest swing of a clamped hair of this length within a tenth of a second, 1/s.
const DRAG_PER_S: f64 = 20.0;

/// Step of a hair that is pushed, s.
const PUSH_DT: f64 = 0.004;

/// Step of a hair that is twisted, s: when it snaps into a loop it meets itself at some metres a second, and at four times
/// this step it tears through itself.
const TWIST_DT: f64 = 0.001;

/// A hair clamped at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClampedHair {
    /// Particles.
    pub n_particles: usize,
    /// Length, cm.
    pub length_cm: f64,
    /// What it is made of; its air drag is replaced.
    pub material: Material,
}

impl ClampedHair {
    /// 20 cm of straight hair in 40 segments.
    #[must_use]
    pub fn standard() -> Self {
        Self { n_particles: 41, length_cm: 20.0, material: Material::straight() }
    }

    /// Length of a segment, cm.
    #[must_use]
    pub fn spacing_cm(&self) -> f64 {
        self.length_cm / (self.n_particles - 1) as f64
    }

    /// EI and GJ of its network.
    ///
    /// # Errors
    /// Constants that leave some motion without resistance.
    pub fn stiffness(&self) -> Result<RodStiffness, Error> {
        let (h, m) = (self.spacing_cm(), &self.material);
        let per_h2 = 1.0 / (h * h);
        let constants = SpringConstants {
            edge_dyn: m.stretch_dyn,
            bend_dyn: m.bend_dyn * per_h2,
            twist_dyn: m.twist_dyn * per_h2,
            altitude_dyn: m.altitude_dyn * per_h2,
        };
        Ok(straight_stiffness(h, &constants)?)
    }

    fn rest(&self) -> Vec<Vector3<f64>> {
        straight_strand(Vector3::zeros(), Vector3::x(), self.length_cm, self.n_particles)
    }

    fn stage(&self) -> Result<Stage, Error> {
        let material = Material { air_drag_per_s: DRAG_PER_S, ..self.material };
        // The strain limit marches from the root and would leave all that it takes off to the segment at the far clamp;
        // between two clamps the springs alone hold the length.
        let params = StepParams { gravity: Vector3::zeros(), strain_limit: f64::INFINITY, ..StepParams::standard() };
        let interaction = InteractionParams { stiction: StictionParams::off(), ..InteractionParams::dry() };
        Stage::new(&self.rest(), self.n_particles, material, params, Some(interaction))
    }

    /// The far clamp moved along and across the hair and turned about it, over a step.
    fn clamp(&self, before: &Clamp, after: &Clamp) -> Drive {
        let n = self.n_particles;
        Drive { strand: 0, particles: (n - 2, n - 1), before: before.pose(), after: after.pose() }
    }
}

/// Where the far clamp stands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Clamp {
    inwards_cm: f64,
    aside_cm: f64,
    turns: f64,
}

impl Clamp {
    /// The hair lies along the x axis, so turning about the axis leaves it there.
    fn pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(-self.inwards_cm, self.aside_cm, 0.0),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), TAU * self.turns),
        )
    }
}

/// What a hair forced into a loop did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LoopFigures {
    /// Distance from its axis in the end, as a share of its length.
    pub off_axis_share: f64,
    /// Writhe in the end: near one (of either sign) if it made a loop.
    pub writhe: f64,
    /// Largest turn from segment to segment in the end, radian; a circle of the loop's whole length turns 2π/n.
    pub largest_turn: f64,
    /// Largest strain of any segment at any time.
    pub largest_strain: f64,
    /// Pairs of its own segments that crossed.
    pub passes: usize,
}

/// Pushes the ends of a hair together by `inwards` of its length while turning one by `turns`; starts with one end
/// `aside_cm` off the axis, which says where it gives way to.
///
/// # Errors
/// A hair that cannot be simulated.
pub fn push_into_loop(
    hair: &ClampedHair,
    inwards: f64,
    turns: f64,
    aside_cm: f64,
) -> Result<(LoopFigures, Film), Error> {
    const PUSH_S: f64 = 4.0;
    const HOLD_S: f64 = 2.0;
    const PICTURES: usize = 8;
    let rest = hair.rest();
    let mut stage = hair.stage()?;
    let n_steps = ((PUSH_S + HOLD_S) / PUSH_DT).round() as usize;
    let clamp_at = |t: f64| Clamp {
        inwards_cm: inwards * hair.length_cm * ease(t, PUSH_S),
        aside_cm: aside_cm * ease(t, 0.1 * PUSH_S),
        turns: turns * ease(t, PUSH_S),
    };
    let mut figures =
        LoopFigures { off_axis_share: 0.0, writhe: 0.0, largest_turn: 0.0, largest_strain: 0.0, passes: 0 };
    stage.shoot();
    let mut before = stage.positions();
    for step in 0..n_steps {
        let t = PUSH_DT * step as f64;
        stage.rest(PUSH_DT, &[hair.clamp(&clamp_at(t), &clamp_at(t + PUSH_DT))]);
        let now = stage.positions();
        figures.largest_strain = figures.largest_strain.max(largest_strain(&now, &rest, hair.n_particles));
        figures.passes += stage.passes_since(&before);
        before = now;
        if (step + 1).is_multiple_of(n_steps.div_ceil(PICTURES - 1)) || step + 1 == n_steps {
            stage.shoot();
        }
    }
    figures.off_axis_share = off_axis(&before, &Vector3::x()) / hair.length_cm;
    figures.writhe = writhe(&before);
    figures.largest_turn = largest_turn(&before);
    Ok((figures, stage.into_film()))
}

/// What a twisted hair did, a row a sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TwistSample {
    /// Turns of the end.
    pub turns: f64,
    /// Distance from the axis, cm.
    pub off_axis_cm: f64,
    /// Writhe.
    pub writhe: f64,
}

/// What a twisted hair did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TwistFigures {
    /// Turns at which a rod of the network's EI and GJ buckles, its ends clamped and free of pull.
    pub critical_turns: f64,
    /// Every so often.
    pub samples: Vec<TwistSample>,
    /// Largest strain of any segment at any time.
    pub largest_strain: f64,
    /// Largest turn from segment to segment in the end, radian.
    pub largest_turn: f64,
    /// Pairs of its own segments that crossed.
    pub passes: usize,
}

/// Turns one end of a hair at `turns_per_s` up to `turns`, with the ends `slack` of its length nearer than it is long.
///
/// # Errors
/// A hair that cannot be simulated.
pub fn twist(
    hair: &ClampedHair,
    slack: f64,
    turns: f64,
    turns_per_s: f64,
    is_meeting: bool,
) -> Result<(TwistFigures, Film), Error> {
    const SLACKEN_S: f64 = 1.0;
    const PICTURES: usize = 8;
    let rest = hair.rest();
    let mut stage = hair.stage()?;
    if !is_meeting {
        stage.interaction = None;
    }
    let twist_s = turns / turns_per_s;
    let n_steps = ((SLACKEN_S + twist_s) / TWIST_DT).round() as usize;
    let clamp_at = |t: f64| Clamp {
        inwards_cm: slack * hair.length_cm * ease(t, SLACKEN_S),
        aside_cm: 0.0,
        turns: turns * ((t - SLACKEN_S) / twist_s).clamp(0.0, 1.0),
    };
    let rod = hair.stiffness()?;
    let mut figures = TwistFigures {
        critical_turns: 8.9868 * rod.mean_bend() / rod.twist / TAU,
        samples: Vec::new(),
        largest_strain: 0.0,
        largest_turn: 0.0,
        passes: 0,
    };
    let mut before = stage.positions();
    for step in 0..n_steps {
        let t = TWIST_DT * step as f64;
        let (from, to) = (clamp_at(t), clamp_at(t + TWIST_DT));
        stage.rest(TWIST_DT, &[hair.clamp(&from, &to)]);
        let now = stage.positions();
        figures.largest_strain = figures.largest_strain.max(largest_strain(&now, &rest, hair.n_particles));
        figures.passes += stage.passes_since(&before);
        before = now;
        if (step + 1) % 100 == 0 {
            let off_axis_cm = off_axis(&before, &Vector3::x());
            figures.samples.push(TwistSample { turns: to.turns, off_axis_cm, writhe: writhe(&before) });
        }
        if (step + 1).is_multiple_of(n_steps.div_ceil(PICTURES)) || step + 1 == n_steps {
            stage.shoot();
        }
    }
    figures.largest_turn = largest_turn(&before);
    Ok((figures, stage.into_film()))
}

/// When a twisted hair would leave the straight line by itself, beside rod theory.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CriticalTwist {
    /// Push of the ends on each other without twist, dyn.
    pub push_dyn: f64,
    /// The same of an Euler column of the network's EI, clamped at both ends: 4π²EI/L².
    pub euler_dyn: f64,
    /// Turns at which the push becomes a pull.
    pub turns: f64,
    /// Turns at which a clamped rod of the network's EI and GJ buckles under twist alone: 8.9868 EI/GJ.
    pub rod_turns: f64,
}

/// Turns one end of a nearly straight hair until its ends no longer push each other apart.
///
/// A hair whose end may slide is straight as long as it pushes that end out, and gives way when it pulls it in. Here the
/// ends are held `slack` of its length nearer than it is long, so that it is bent by next to nothing, and the force on them
/// is read; where it changes sign is the critical twist. Turned faster than about a tenth of a turn a second the hair swings
/// and pulls too early.
///
/// # Errors
/// A hair that cannot be simulated.
pub fn critical_twist(hair: &ClampedHair, slack: f64, turns_per_s: f64) -> Result<CriticalTwist, Error> {
    const SLACKEN_S: f64 = 1.0;
    /// Turns given up after; about twice what a rod of round section takes.
    const MOST_TURNS: f64 = 4.0;
    let mut stage = hair.stage()?;
    // Hardly bent, it cannot meet itself.
    stage.interaction = None;
    let rod = hair.stiffness()?;
    let n_slacken = (2.0 * SLACKEN_S / PUSH_DT).round() as usize;
    let n_twist = (MOST_TURNS / turns_per_s.abs() / PUSH_DT).round() as usize;
    let clamp_at = |t: f64| Clamp {
        inwards_cm: slack * hair.length_cm * ease(t, SLACKEN_S),
        // A hair's breadth, so that a straight hair knows where to.
        aside_cm: 0.01,
        turns: turns_per_s * (t - 2.0 * SLACKEN_S).max(0.0),
    };
    let free_cm = hair.length_cm - 2.0 * hair.spacing_cm();
    let mut out = CriticalTwist {
        push_dyn: f64::NAN,
        euler_dyn: TAU * TAU * rod.mean_bend() / (free_cm * free_cm),
        turns: f64::NAN,
        rod_turns: 8.9868 * rod.mean_bend() / rod.twist / TAU,
    };
    // Swings are taken out by a mean over a fifth of a second.
    const N_MEAN: usize = 50;
    let mut pushes = Vec::with_capacity(n_slacken + n_twist);
    for step in 0..n_slacken + n_twist {
        let t = PUSH_DT * step as f64;
        stage.rest(PUSH_DT, &[hair.clamp(&clamp_at(t), &clamp_at(t + PUSH_DT))]);
        pushes.push(stage.cut_force(0, hair.n_particles / 2).x);
        let Some(from) = pushes.len().checked_sub(N_MEAN) else { continue };
        let mean = pushes[from..].iter().sum::<f64>() / N_MEAN as f64;
        if step + 1 == n_slacken {
            out.push_dyn = mean;
        }
        if step >= n_slacken + N_MEAN && mean < 0.0 {
            out.turns = clamp_at(t - 0.5 * PUSH_DT * N_MEAN as f64).turns;
            break;
        }
    }
    Ok(out)
}
