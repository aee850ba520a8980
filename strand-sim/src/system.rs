//! A set of strands ready to be stepped: springs with their constants, grouped into batches of equal topology.
//!
//! The system knows no guides and no normal hairs: it steps whatever strands it is given. Strands keep their order at the
//! interface; inside, strands of one rig kind stand side by side in the lanes of a batch. A strand's result does not
//! depend on which lane it sits in or which strands share its batch.

use crate::altitude::{AltitudeRest, AltitudeRestLanes, CANDIDATES};
use crate::bearing::Bearings;
use crate::error::Error;
use crate::lanes::{LANES, Lane, Lane3, ZERO};
use crate::material::Material;
use crate::rig::perturb::{rig_particles, where_straight};
use crate::rig::{ALTITUDE, MIN_PARTICLES, N_CONSTANTS, Perturbed, SpringKind, Topology, altitude_constants};
use crate::watch::Sights;
use nalgebra::{Isometry3, Vector3};
use std::collections::BTreeMap;

/// Shortest strand accepted, cm.
pub const MIN_LENGTH_CM: f64 = 1e-3;

const NO_ALTITUDE: AltitudeRestLanes = AltitudeRestLanes { length: [ZERO; CANDIDATES], floor: ZERO, preferred: ZERO };

/// Up to [`LANES`] strands of one topology. Lanes past the last strand repeat it and are ignored.
#[derive(Clone, Debug)]
pub(crate) struct Batch {
    /// Index into [`StrandSystem::topologies`].
    pub topology: usize,
    /// Strand in each lane.
    pub strands: Vec<u32>,
    /// Rest shape in the head frame, one entry per rig particle, cm.
    pub rest_in_head: Vec<Lane3>,
    /// Mass per rig particle, g.
    pub mass: Vec<Lane>,
    /// Force at strain one per kind of spring, dyn.
    pub stiffness: [Lane; N_CONSTANTS],
    /// Reciprocal rest length per spring, 1/cm.
    pub inv_rest_length: Vec<Lane>,
    /// Damping per kind of spring, dyn·s/cm.
    pub damping: [Lane; N_CONSTANTS],
    /// Rest lengths of the altitude springs, one entry for each four consecutive rig particles.
    pub altitude_rest: Vec<AltitudeRestLanes>,
    /// Rest distance between neighbouring particles of the hair, per segment, cm.
    pub segment_length: Vec<Lane>,
}

/// Strands, their springs and their rest shapes.
#[derive(Clone, Debug)]
pub struct StrandSystem {
    pub(crate) n_strands: usize,
    pub(crate) n_main: usize,
    pub(crate) material: Material,
    pub(crate) topologies: Vec<Topology>,
    pub(crate) batches: Vec<Batch>,
    /// Batch and lane of each strand.
    pub(crate) place: Vec<(u32, u8)>,
}

/// Positions and velocities of all rig particles, in the world frame.
#[derive(Clone, Debug)]
pub struct StrandState {
    pub(crate) batches: Vec<BatchState>,
}

#[derive(Clone, Debug)]
pub(crate) struct BatchState {
    /// cm, one entry per rig particle.
    pub position: Vec<Lane3>,
    /// cm/s.
    pub velocity: Vec<Lane3>,
    /// What was last sampled of each rigid solid.
    pub sights: Vec<Sights>,
    /// Lower bound of each strand's distance to each deforming body, minus all movement since it was measured, cm.
    /// Resized when the number of bodies changes.
    pub clearance: Vec<Lane>,
    /// Where strands bore on solids.
    pub bearings: Bearings,
}

impl StrandSystem {
    /// Builds the rig of every strand, unstressed in the given shape.
    ///
    /// `points_in_head` holds `n_main` points a strand, strand-major, root first, cm.
    ///
    /// # Errors
    /// A material out of range, too few particles, a point that is not finite, or a strand shorter than
    /// [`MIN_LENGTH_CM`].
    pub fn new(points_in_head: &[Vector3<f64>], n_main: usize, material: Material) -> Result<Self, Error> {
        material.validate()?;
        if n_main < MIN_PARTICLES {
            return Err(Error::TooFewParticles { n_particles: n_main, minimum: MIN_PARTICLES });
        }
        if !points_in_head.len().is_multiple_of(n_main) {
            return Err(Error::RaggedPoints { n_points: points_in_head.len(), n_particles: n_main });
        }
        let n_strands = points_in_head.len() / n_main;
        let mut by_topology: BTreeMap<Perturbed, Vec<u32>> = BTreeMap::new();
        for (s, points) in points_in_head.chunks_exact(n_main).enumerate() {
            if let Some(particle) = points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
                return Err(Error::NonFinite { strand: s, particle });
            }
            let length_cm: f64 = points.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
            if length_cm < MIN_LENGTH_CM || points.windows(2).any(|w| w[0] == w[1]) {
                return Err(Error::TooShort { strand: s, length_cm, minimum_cm: MIN_LENGTH_CM });
            }
            by_topology.entry(where_straight(points)).or_default().push(s as u32);
        }
        let topologies: Vec<_> = by_topology.keys().map(Topology::new).collect();
        let mut batches = Vec::new();
        for (topology, strands) in by_topology.values().enumerate() {
            for group in strands.chunks(LANES) {
                batches.push(Batch::new(topology, &topologies[topology], group, points_in_head, &material));
            }
        }
        let mut place = vec![(0, 0); n_strands];
        for (b, batch) in batches.iter().enumerate() {
            for (lane, &strand) in batch.strands.iter().enumerate() {
                place[strand as usize] = (b as u32, lane as u8);
            }
        }
        Ok(Self { n_strands, n_main, material, topologies, batches, place })
    }

    /// Strands.
    #[must_use]
    pub fn n_strands(&self) -> usize {
        self.n_strands
    }

    /// Particles per strand, perturbed ones not counted.
    #[must_use]
    pub fn n_particles(&self) -> usize {
        self.n_main
    }

    /// Strands that carry perturbed particles.
    #[must_use]
    pub fn n_straight(&self) -> usize {
        let perturbed = |b: &&Batch| self.topologies[b.topology].perturbed.count() > 0;
        self.batches.iter().filter(perturbed).map(|b| b.strands.len()).sum()
    }

    /// Every strand at rest and still, carried by the head.
    #[must_use]
    pub fn rest_state(&self, world_from_head: &Isometry3<f64>) -> StrandState {
        let batches = self
            .batches
            .iter()
            .map(|batch| {
                let mut position = batch.rest_in_head.clone();
                for p in &mut position {
                    for l in 0..LANES {
                        set(p, l, transform(world_from_head, get(p, l)));
                    }
                }
                BatchState {
                    velocity: vec![[ZERO; 3]; position.len()],
                    sights: Vec::new(),
                    clearance: Vec::new(),
                    bearings: Bearings::new(position.len()),
                    position,
                }
            })
            .collect();
        StrandState { batches }
    }

    /// Every strand still in a given shape, e.g. a settled one; perturbed particles are placed as in the rest shape.
    /// `points_in_head` is ordered as in [`StrandSystem::new`].
    ///
    /// # Errors
    /// [`Error::RaggedPoints`] unless there are exactly the particles of this system.
    pub fn state_of_shape(
        &self,
        points_in_head: &[Vector3<f64>],
        world_from_head: &Isometry3<f64>,
    ) -> Result<StrandState, Error> {
        if points_in_head.len() != self.n_strands * self.n_main {
            return Err(Error::RaggedPoints { n_points: points_in_head.len(), n_particles: self.n_main });
        }
        let mut state = self.rest_state(world_from_head);
        for (batch, batch_state) in self.batches.iter().zip(&mut state.batches) {
            for (lane, &strand) in batch.strands.iter().enumerate() {
                let points = &points_in_head[strand as usize * self.n_main..][..self.n_main];
                let rig = rig_particles(&self.topologies[batch.topology], points);
                for (p, point) in batch_state.position.iter_mut().zip(rig) {
                    set(p, lane, transform(world_from_head, point));
                }
            }
        }
        Ok(state)
    }

    /// Copies the hair's own particles out, `n_main` a strand in strand order: positions (cm) and velocities (cm/s).
    pub fn read(&self, state: &StrandState, mut sink: impl FnMut(usize, usize, Vector3<f64>, Vector3<f64>)) {
        for (batch, batch_state) in self.batches.iter().zip(&state.batches) {
            let topology = &self.topologies[batch.topology];
            for (lane, &strand) in batch.strands.iter().enumerate() {
                for i in 0..self.n_main {
                    let p = topology.rig_of_main(i);
                    sink(strand as usize, i, get(&batch_state.position[p], lane), get(&batch_state.velocity[p], lane));
                }
            }
        }
    }

    /// Positions of the hair's own particles, strand-major, root first, cm.
    #[must_use]
    pub fn positions(&self, state: &StrandState) -> Vec<Vector3<f64>> {
        let mut out = vec![Vector3::zeros(); self.n_strands * self.n_main];
        self.read(state, |s, i, x, _| out[s * self.n_main + i] = x);
        out
    }
}

impl Batch {
    /// Sets the right side of a solve, three lanes a free rig particle, to mass times a velocity (cm/s).
    pub fn fill_weight(&self, n_kinematic: usize, n_rig: usize, velocity: &Vector3<f64>, rhs: &mut [Lane]) {
        for p in n_kinematic..n_rig {
            for c in 0..3 {
                for l in 0..LANES {
                    rhs[3 * (p - n_kinematic) + c][l] = self.mass[p][l] * velocity[c];
                }
            }
        }
    }

    fn new(
        topology_idx: usize,
        topology: &Topology,
        strands: &[u32],
        points_in_head: &[Vector3<f64>],
        material: &Material,
    ) -> Self {
        let n_main = topology.n_main;
        let n_springs = topology.springs.len();
        let mut batch = Self {
            topology: topology_idx,
            strands: strands.to_vec(),
            rest_in_head: vec![[ZERO; 3]; topology.n_rig],
            mass: vec![ZERO; topology.n_rig],
            stiffness: [ZERO; N_CONSTANTS],
            inv_rest_length: vec![ZERO; n_springs],
            damping: [ZERO; N_CONSTANTS],
            altitude_rest: vec![NO_ALTITUDE; topology.n_rig - 3],
            segment_length: vec![ZERO; n_main - 1],
        };
        for lane in 0..LANES {
            let strand = strands[lane.min(strands.len() - 1)] as usize;
            let points = &points_in_head[strand * n_main..][..n_main];
            let rig = rig_particles(topology, points);
            let mut length = 0.0;
            for (j, w) in points.windows(2).enumerate() {
                batch.segment_length[j][lane] = (w[1] - w[0]).norm();
                length += batch.segment_length[j][lane];
            }
            let h_cm = length / (n_main - 1) as f64;
            for (p, (x, mass)) in rig.iter().zip(topology.masses(material, h_cm)).enumerate() {
                set(&mut batch.rest_in_head[p], lane, *x);
                batch.mass[p][lane] = mass;
            }
            for kind in [SpringKind::Edge, SpringKind::Bend, SpringKind::Torsion] {
                let (stiffness, damping) = kind.constants(material, h_cm);
                batch.stiffness[kind as usize][lane] = stiffness;
                batch.damping[kind as usize][lane] = damping;
            }
            let (stiffness, damping) = altitude_constants(material, h_cm);
            batch.stiffness[ALTITUDE][lane] = stiffness;
            batch.damping[ALTITUDE][lane] = damping;
            for (corners, rest) in rig.array_windows().zip(&mut batch.altitude_rest) {
                rest.set(lane, &AltitudeRest::new(corners));
            }
            for (k, spring) in topology.springs.iter().enumerate() {
                batch.inv_rest_length[k][lane] = 1.0 / (rig[spring.b] - rig[spring.a]).norm();
            }
        }
        batch
    }
}

#[inline(always)]
pub(crate) fn get(v: &Lane3, lane: usize) -> Vector3<f64> {
    Vector3::new(v[0][lane], v[1][lane], v[2][lane])
}

#[inline(always)]
pub(crate) fn set(v: &mut Lane3, lane: usize, value: Vector3<f64>) {
    v[0][lane] = value.x;
    v[1][lane] = value.y;
    v[2][lane] = value.z;
}

pub(crate) fn transform(iso: &Isometry3<f64>, p: Vector3<f64>) -> Vector3<f64> {
    iso.transform_point(&p.into()).coords
}
