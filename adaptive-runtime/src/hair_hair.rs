//! Hair against hair, as an output stage of a read: volume kept, and friction between neighbours.
//!
//! AS16 §3 and §5 resolve collisions between normal hairs by correcting positions after interpolation, as Chai, Zheng and
//! Zhou 2014 do. Here hair is taken as a continuum: particles are counted on a grid that stands still in the head frame; where there
//! are more than these hairs had around them at rest, a pressure that is never negative spreads them, lengths kept; and motion against the
//! neighbours since the read before is damped towards their mean. The simulation never sees the result: contact is tested
//! on uncorrected hair. No state is carried from read to read but the positions of the read before, which the caller holds.
//!
//! Invariants: hair at rest is left bit for bit alone, wherever the head is; roots do not move; no particle moves farther
//! than `max_shift_cm` nor farther than its strand's clearance; same bytes for any number of threads.

mod apply;
mod density;
mod lattice;
mod pressure;

#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;

use apply::{Field, LANES, Limits, Scratch, StrandMove};
use collision::Solid;
use density::Density;
use lattice::Frame;
use nalgebra::Isometry3;
use pressure::Pressure;
use rayon::prelude::*;

use crate::error::Error;

/// Correction of hair against hair at a read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HairHairParams {
    /// Whether reads are corrected at all.
    pub enabled: bool,
    /// Edge of a grid cell, cm. Half the particles' spacing along a strand or more: the smoothing of the count then takes out
    /// the layers that particles of even spacing form.
    pub cell_cm: f32,
    /// Share by which hair may be denser than at rest before it is spread; greater than zero.
    pub slack: f32,
    /// Hair thinner than this share of the mean density at rest presses on nothing.
    pub thin: f32,
    /// Most that a particle is moved, cm.
    pub max_shift_cm: f32,
    /// Share of a hair's motion against its neighbours since the read before that is taken away in hair as dense as at rest,
    /// 0 to 1; zero leaves friction out, and saves its cost.
    pub friction: f32,
    /// How much more than its excess dense hair is asked to spread in one pass: the smoothing of counts and along strands
    /// lets through less than what is asked for.
    pub gain: f32,
    /// Relaxation sweeps of the pressure at each of four levels of the grid.
    pub sweeps: u32,
}

impl HairHairParams {
    /// What the figures in docs/DEVIATIONS.md were measured with, friction left out.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            enabled: true,
            cell_cm: 0.5,
            slack: 0.05,
            thin: 0.1,
            max_shift_cm: 1.0,
            gain: 2.0,
            friction: 0.0,
            sweeps: 12,
        }
    }

    /// As [`HairHairParams::standard`], with friction.
    #[must_use]
    pub fn with_friction() -> Self {
        Self { friction: 0.3, ..Self::standard() }
    }

    /// Checks every field a read divides by or loops over.
    ///
    /// # Errors
    /// [`Error::BadParameter`] names the first field out of range.
    pub fn validate(&self) -> Result<(), Error> {
        for (name, value) in [
            ("hair_hair.cell_cm", self.cell_cm),
            ("hair_hair.slack", self.slack),
            ("hair_hair.gain", self.gain),
            ("hair_hair.max_shift_cm", self.max_shift_cm),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::BadParameter {
                    name,
                    value: value.into(),
                    expected: "finite and greater than zero",
                });
            }
        }
        for (name, value) in [("hair_hair.thin", self.thin), ("hair_hair.friction", self.friction)] {
            if !(0.0..=1.0).contains(&value) {
                return Err(Error::BadParameter { name, value: value.into(), expected: "from zero to one" });
            }
        }
        Ok(())
    }
}

/// What a correction met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HairHairReport {
    /// Mean over particles of the density beyond `1 + slack` times that at rest, as a share of it, before the correction.
    pub mean_excess: f32,
    /// Largest of it over cells.
    pub peak_excess: f32,
    /// Strands that were moved.
    pub moved_strands: u32,
}

/// Where the hair of a read stands, and where it stood at the read before.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReadPoses<'a> {
    /// Takes the head frame to that of the positions: the identity if they are in the head frame.
    pub world_from_head: Isometry3<f64>,
    /// Positions as the read before gave them out, with their pose; without them there is no friction.
    pub previous: Option<(&'a [[f32; 3]], Isometry3<f64>)>,
}

/// Hair-hair correction of one head: what it knows of the hair at rest, and its buffers.
#[derive(Debug)]
pub(crate) struct HairHair {
    n_particles: usize,
    n_fixed: usize,
    params: HairHairParams,
    density: Density,
    pressure: Pressure,
    field: Field,
    pieces: Vec<Scratch>,
}

/// Pieces that the strands are divided into for the last pass; more than threads, so that they share the work evenly.
const PIECES: usize = 64;

impl HairHair {
    /// Counts the hair at rest. `rest_in_head` is strand-major, cm; the first `n_fixed` particles of a strand never move;
    /// `head` is the head in its own frame, which hair is not pushed into.
    ///
    /// # Errors
    /// [`Error::BadParameter`], as [`HairHairParams::validate`].
    pub(crate) fn new(
        rest_in_head: &[[f32; 3]],
        n_particles: usize,
        n_fixed: usize,
        head: Option<&Solid>,
        params: HairHairParams,
    ) -> Result<Self, Error> {
        params.validate()?;
        Ok(Self {
            n_particles,
            n_fixed,
            params,
            density: Density::at_rest(rest_in_head, &params),
            pressure: Pressure::new(head.cloned(), params.cell_cm),
            field: Field::default(),
            pieces: vec![Scratch::new(n_particles); PIECES],
        })
    }

    /// Corrects the positions of a read in place: strand-major, cm, in the frame that `poses` names.
    ///
    /// `clearance` gives, for each strand, a length (cm) that all of it may move without meeting a solid, at most; a strand
    /// in contact has none and stays. The head needs no part in it: the displacement field keeps off the head by itself.
    pub(crate) fn correct(
        &mut self,
        positions: &mut [[f32; 3]],
        poses: &ReadPoses,
        clearance: impl Fn(usize) -> f32 + Sync,
    ) -> HairHairReport {
        let mut report = HairHairReport::default();
        let n = self.n_particles;
        if !self.params.enabled || positions.is_empty() {
            return report;
        }
        let frame = Frame::new(&poses.world_from_head);
        let lattice = self.density.count(positions, n, &frame);
        (report.mean_excess, report.peak_excess) = self.density.excess_over_rest(&self.params);
        let friction = self.params.friction > 0.0;
        let previous = poses.previous.filter(|_| friction).map(|(at, pose)| (at, Frame::new(&pose)));
        let pressed = report.peak_excess > 0.0;
        if !pressed && previous.is_none() {
            return report;
        }
        self.pressure.solve(&lattice, self.density.excess(), pressed, &self.params);
        self.field.spread(&lattice, &self.pressure, &self.params);
        if let Some((previous, previous_frame)) = &previous {
            self.density.add_motion(positions, &frame, previous, previous_frame);
            self.field.rub(&lattice, &self.density, self.params.friction);
        }
        let limits = Limits { max_shift: self.params.max_shift_cm, inv_cell: 1.0 / self.params.cell_cm };
        let (field, head, n_fixed) = (&self.field, self.pressure.head(), self.n_fixed.max(1));
        let per_piece = (positions.len() / n).div_ceil(PIECES).max(1);
        report.moved_strands = positions
            .par_chunks_mut(per_piece * n)
            .zip(&mut self.pieces)
            .enumerate()
            .map(|(piece, (strands, scratch))| {
                let mut moved = 0;
                for (k, group) in strands.chunks_mut(LANES * n).enumerate() {
                    let first = piece * per_piece + k * LANES;
                    let old = previous.as_ref().map(|(p, frame)| (&p[first * n..first * n + group.len()], frame));
                    let case = StrandMove {
                        lattice: &lattice,
                        field,
                        head,
                        limits,
                        n_particles: n,
                        n_fixed,
                        frame: &frame,
                        previous: old,
                    };
                    moved += case.apply(group, &clearance, first, scratch);
                }
                moved
            })
            .sum();
        report
    }
}
