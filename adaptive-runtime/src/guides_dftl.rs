//! Dynamic follow-the-leader (Müller, Kim, Chentanez 2012, *Fast Simulation of Inextensible Hair and Fur*): the integrator
//! that AS16 §7.2 compares its guides with.
//!
//! From the root on, every particle is put at its distance from the one before it, which moves on for good; what that takes
//! from the momentum of the one before is given back to its velocity. There is neither bending nor twist. Invariant: segments
//! have their lengths to round-off after every step, whatever pushes the hair. Solids push particles out; teeth between
//! two particles are not seen.

use crate::params::DftlParams;
use collision::MovingSolid;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use strand_sim::{StepInput, StepParams, StepReport};

/// Particles at the root that move with the head: they fix where the hair begins and where it points.
const N_FIXED: usize = 2;

/// Times that a particle is moved out of solids and back to its distance: on a smooth surface twice is enough.
const PUSHES: usize = 4;

/// Guides that fall by follow-the-leader.
#[derive(Debug)]
pub(crate) struct Dftl {
    n_particles: usize,
    params: DftlParams,
    /// Guide-major, head frame, cm.
    rest_in_head: Vec<Vector3<f64>>,
    /// Distance to the particle before, cm; zero at roots.
    length: Vec<f64>,
    /// Reciprocal mass of a particle, one a guide, 1/g.
    inv_mass: Vec<f64>,
    /// Guide-major, world frame, cm.
    position: Vec<Vector3<f64>>,
    /// cm/s.
    velocity: Vec<Vector3<f64>>,
}

impl Dftl {
    /// At rest in the given shape (head frame, cm), at the head's pose; of a given mass per length (g/cm).
    pub(crate) fn new(
        rest_in_head: Vec<Vector3<f64>>,
        n_particles: usize,
        density_g_per_cm: f64,
        world_from_head: &Isometry3<f64>,
        params: DftlParams,
    ) -> Self {
        let is_root = |k: usize| k.is_multiple_of(n_particles);
        let length: Vec<f64> = (0..rest_in_head.len())
            .map(|k| if is_root(k) { 0.0 } else { (rest_in_head[k] - rest_in_head[k - 1]).norm() })
            .collect();
        let mass_of = |of: &[f64]| density_g_per_cm * of.iter().sum::<f64>() / (n_particles - 1) as f64;
        let inv_mass = length.chunks_exact(n_particles).map(|of| 1.0 / mass_of(of)).collect();
        let position = rest_in_head.iter().map(|x| (world_from_head * Point3::from(*x)).coords).collect();
        let velocity = vec![Vector3::zeros(); rest_in_head.len()];
        Self { n_particles, params, rest_in_head, length, inv_mass, position, velocity }
    }

    /// Guide-major, world frame, cm.
    pub(crate) fn position(&self) -> &[Vector3<f64>] {
        &self.position
    }

    /// Carries everything rigidly.
    pub(crate) fn carry(&mut self, to_there: &Isometry3<f64>) {
        for (x, v) in self.position.iter_mut().zip(&mut self.velocity) {
            *x = (to_there * Point3::from(*x)).coords;
            *v = to_there.rotation * *v;
        }
    }

    /// Advances all guides. Surfaces, deforming bodies, driven particles and wind are not looked at.
    pub(crate) fn step(&mut self, input: &StepInput, step: &StepParams) -> StepReport {
        let n = self.n_particles;
        let (rest, length, inv_mass, params) = (&self.rest_in_head, &self.length, &self.inv_mass, self.params);
        let guides = self.position.par_chunks_mut(n).zip(self.velocity.par_chunks_mut(n)).enumerate();
        let (contacts, quarantined) = guides
            .map(|(guide, (position, velocity))| {
                let of = guide * n..(guide + 1) * n;
                let strand = Strand {
                    world_from_head: input.roots.at(guide, 1.0),
                    rest: &rest[of.clone()],
                    length: &length[of.clone()],
                    forces: if input.forces.is_empty() { &[] } else { &input.forces[of] },
                    inv_mass: inv_mass[guide],
                    params,
                };
                let contacts = strand.step(position, velocity, input, step);
                let is_finite = position.iter().chain(velocity.iter()).all(|v| v.iter().all(|x| x.is_finite()));
                if !is_finite {
                    strand.put_back(position, velocity);
                }
                (contacts, u32::from(!is_finite))
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        StepReport { substeps: 1, contacts, quarantined, ..StepReport::default() }
    }
}

/// One guide during a step.
struct Strand<'a> {
    world_from_head: Isometry3<f64>,
    rest: &'a [Vector3<f64>],
    length: &'a [f64],
    /// dyn; empty for none.
    forces: &'a [Vector3<f64>],
    inv_mass: f64,
    params: DftlParams,
}

impl Strand<'_> {
    fn at_rest(&self, i: usize) -> Vector3<f64> {
        (self.world_from_head * Point3::from(self.rest[i])).coords
    }

    /// Moves one guide; returns how many of its particles a solid pushed.
    fn step(
        &self,
        position: &mut [Vector3<f64>],
        velocity: &mut [Vector3<f64>],
        input: &StepInput,
        step: &StepParams,
    ) -> u64 {
        let (dt, mut contacts) = (input.dt, 0);
        let kept = 1.0 / (1.0 + self.params.drag_per_s * dt);
        for i in 0..N_FIXED {
            let now = self.at_rest(i);
            velocity[i] = (now - position[i]) / dt;
            position[i] = now;
        }
        for i in N_FIXED..position.len() {
            let force = self.forces.get(i).map_or(Vector3::zeros(), |f| f * self.inv_mass);
            let thrown = velocity[i] * kept + (step.gravity + force) * dt;
            let predicted = position[i] + thrown * dt;
            let leader = position[i - 1];
            let mut placed = self.follow(i, leader, predicted, position[i]);
            let mut is_pushed = false;
            for _ in 0..PUSHES {
                let Some(out) = push_out(placed, input.solids, step.contact.offset_cm) else { break };
                is_pushed = true;
                placed = self.follow(i, leader, out, placed);
            }
            contacts += u64::from(is_pushed);
            // Müller et al. 2012, Eq. (9): the leader gets back what following it took from its momentum.
            if i > N_FIXED {
                velocity[i - 1] -= (placed - predicted) * (self.params.correction / dt);
            }
            velocity[i] = (placed - position[i]) / dt;
            position[i] = placed;
        }
        contacts
    }

    /// The place nearest `wanted` at the particle's distance from its leader; in the direction of `otherwise` where that has
    /// none.
    fn follow(&self, i: usize, leader: Vector3<f64>, wanted: Vector3<f64>, otherwise: Vector3<f64>) -> Vector3<f64> {
        let direction = (wanted - leader)
            .try_normalize(f64::MIN_POSITIVE)
            .or_else(|| (otherwise - leader).try_normalize(f64::MIN_POSITIVE))
            .unwrap_or_else(|| -Vector3::y());
        leader + direction * self.length[i]
    }

    fn put_back(&self, position: &mut [Vector3<f64>], velocity: &mut [Vector3<f64>]) {
        for (i, x) in position.iter_mut().enumerate() {
            *x = self.at_rest(i);
        }
        velocity.fill(Vector3::zeros());
    }
}

/// Where a point in a solid, as it stands at the end of the step, leaves it by the shortest way; none for a point outside all.
fn push_out(point: Vector3<f64>, solids: &[MovingSolid], offset_cm: f64) -> Option<Vector3<f64>> {
    let mut out = None;
    for moving in solids {
        let at = out.unwrap_or(point);
        let in_solid = moving.pose.to.inverse_transform_point(&Point3::from(at)).coords.cast();
        let field = &moving.solid.sdf;
        if f64::from(field.distance(in_solid)) < offset_cm {
            let (distance, normal) = field.outward_normal(in_solid);
            out = Some(at + moving.pose.to.rotation * normal.cast() * (offset_cm - f64::from(distance)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use collision::{Shape, Solid, SolidPose};

    const N: usize = 12;
    const DT_S: f64 = 0.01;
    /// Round-off of places some ten centimetres from the origin.
    const ROUND_OFF_CM: f64 = 1e-12;

    /// Strands that stick out of a head in all directions, `lift` times sideways against down.
    fn strands(lift: f64) -> Vec<Vector3<f64>> {
        (0..16)
            .flat_map(|s| {
                let angle = 0.4 * f64::from(s);
                let way = Vector3::new(lift * angle.cos(), -1.0, lift * angle.sin()).normalize();
                (0..N).map(move |i| way * (5.0 + 0.7 * i as f64))
            })
            .collect()
    }

    fn guides(lift: f64, pose: &Isometry3<f64>) -> Dftl {
        Dftl::new(strands(lift), N, 5e-5, pose, DftlParams::standard())
    }

    fn largest_stretch(dftl: &Dftl) -> f64 {
        (0..dftl.position.len())
            .filter(|k| k % N != 0)
            .map(|k| ((dftl.position[k] - dftl.position[k - 1]).norm() - dftl.length[k]).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn lengths_are_exact_however_the_head_is_shaken_and_whatever_is_in_the_way() {
        let head =
            Solid::from_shape("head", &Shape::sphere(Vector3::zeros(), 4.8).into(), 0.25, 1.0, 0.3).expect("sound");
        let pose = |k: usize| Isometry3::new(Vector3::x() * (0.9 * k as f64).sin(), Vector3::y() * 0.02 * k as f64);
        // Upwards, onto the head that the hair hangs from.
        let params = StepParams { gravity: Vector3::y() * 981.0, ..StepParams::standard() };
        let (mut dftl, mut contacts) = (guides(2.0, &pose(0)), 0);
        for k in 0..200 {
            let solids = [MovingSolid { solid: &head, pose: SolidPose { from: pose(k), to: pose(k + 1) } }];
            let input = StepInput { solids: &solids, ..StepInput::carried(DT_S, pose(k), pose(k + 1)) };
            contacts += dftl.step(&input, &params).contacts;
            assert!(largest_stretch(&dftl) < ROUND_OFF_CM, "step {k}");
        }
        assert!(contacts > 100, "hair must fall on the head: {contacts} contacts");
    }

    #[test]
    fn hair_that_hangs_stays_where_it_is() {
        let pose = Isometry3::identity();
        let mut dftl = guides(0.0, &pose);
        let before = dftl.position.clone();
        for _ in 0..500 {
            dftl.step(&StepInput::still(DT_S, pose), &StepParams::standard());
        }
        let moved = before.iter().zip(&dftl.position).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(moved < ROUND_OFF_CM, "{moved} cm");
    }

    #[test]
    fn hair_that_is_let_go_comes_to_hang() {
        /// Sideways distance of a tip from below its root, of what is left of a swing after ten seconds, cm.
        const HANGS_CM: f64 = 0.05;
        let pose = Isometry3::identity();
        let mut dftl = guides(1.0, &pose);
        for _ in 0..1_000 {
            dftl.step(&StepInput::still(DT_S, pose), &StepParams::standard());
        }
        for strand in dftl.position.chunks_exact(N) {
            let hang = strand[N - 1] - strand[N_FIXED - 1];
            assert!(hang.xz().norm() < HANGS_CM, "{hang:?}");
        }
    }

    #[test]
    fn guides_are_the_same_bytes_for_any_number_of_threads() {
        let run = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().expect("threads");
            pool.install(|| {
                let mut dftl = guides(1.0, &Isometry3::identity());
                for _ in 0..50 {
                    dftl.step(&StepInput::still(DT_S, Isometry3::identity()), &StepParams::standard());
                }
                dftl.position.iter().flat_map(|x| x.iter().map(|c| c.to_bits()).collect::<Vec<_>>()).collect::<Vec<_>>()
            })
        };
        assert!(run(1) == run(2) && run(1) == run(8));
    }
}
