//! Rest lengths under which a styled groom hangs in its styled shape: no sag on the first step.
//!
//! Springs that are unstressed in the styled shape let it sag. Here the stress that carries the hair's weight is found by
//! one linear solve with the directions of MS08 §4.1 frozen, and rest lengths are changed to exert it: where the solve
//! would have moved the hair, springs are tightened instead. A fibre bears only so much: a strand whose equilibrium would
//! be unstable (its tangent stiffness, compression included, not positive definite) or whose springs would change by more
//! than a stated share is given a part of its support, or none, and the report says what is left.

mod relax;

use crate::altitude::altitude_lanes;
use crate::body_contact::Contact;
use crate::forces::{Implicit, linearise};
use crate::implicit::{self, Problem};
use crate::lanes::{LANES, Lane, ZERO};
use crate::rig::ALTITUDE;
use crate::step::{Span, StepInput, StepParams, Work};
use crate::system::{Batch, BatchState, StrandState, StrandSystem, get, set, transform};
use collision::MovingSolid;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// Time (s) that the linear solve is given: long against any swing of hair, so that what it finds is the end of it.
const STATIC_S: f64 = 30.0;

/// Further solves that take what round-off left.
const REFINEMENTS: usize = 3;

/// Largest change of a spring's rest length, as a share of it.
const LARGEST_CHANGE: f64 = 0.3;

/// Shares of its support that a strand is offered, from all of it down.
const SHARES: [f64; 5] = [1.0, 0.75, 0.5, 0.25, 0.125];

/// Gap up to which a strand counts as lying on a solid, cm: hair at rest on one falls by g h² in a substep of 5 ms and is
/// pushed out again, so that is how far off a settled contact may be found.
const LYING_CM: f64 = 0.025;

/// What balancing came to. Residuals are the net force on a particle over its weight, contact forces counted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RestReport {
    /// Root mean square residual of all free particles before.
    pub residual_before: f64,
    /// The same afterwards.
    pub residual_after: f64,
    /// Largest residual of any particle afterwards.
    pub worst_after: f64,
    /// Strands that hold their shape fully.
    pub held: usize,
    /// Strands that hold it in part or not at all.
    pub given_up: usize,
}

/// Sums of one batch.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    before: f64,
    after: f64,
    worst: f64,
    particles: usize,
    held: usize,
    given_up: usize,
}

impl StrandState {
    /// The same strands, positions and velocities, moved rigidly by `to_there`.
    #[must_use]
    pub fn carried(mut self, to_there: &Isometry3<f64>) -> Self {
        self.carry(to_there);
        self
    }

    /// Moves the strands rigidly by `to_there`, as [`Self::carried`], in place.
    pub fn carry(&mut self, to_there: &Isometry3<f64>) {
        for batch in &mut self.batches {
            for l in 0..LANES {
                for x in &mut batch.position {
                    set(x, l, transform(to_there, get(x, l)));
                }
                for v in &mut batch.velocity {
                    set(v, l, to_there.rotation * get(v, l));
                }
            }
            // Distances to solids were those of the place before.
            batch.clearance.clear();
        }
    }
}

impl StrandSystem {
    /// Changes rest lengths so that `state`, its velocities aside, is an equilibrium under gravity on the given resting
    /// solids; `world_from_head` is the head's pose in it.
    pub fn balance(
        &mut self,
        state: &mut StrandState,
        world_from_head: &Isometry3<f64>,
        solids: &[MovingSolid],
        params: &StepParams,
    ) -> RestReport {
        let input = StepInput { solids, ..StepInput::still(STATIC_S, *world_from_head) };
        let mut batches = std::mem::take(&mut self.batches);
        let sums: Vec<Sums> = batches
            .par_iter_mut()
            .zip(state.batches.par_iter_mut())
            .map_init(|| Work::new(self), |work, (batch, state)| self.balance_batch(batch, state, &input, params, work))
            .collect();
        self.batches = batches;
        let total = sums.iter().fold(Sums::default(), |a, b| Sums {
            before: a.before + b.before,
            after: a.after + b.after,
            worst: a.worst.max(b.worst),
            particles: a.particles + b.particles,
            held: a.held + b.held,
            given_up: a.given_up + b.given_up,
        });
        let mean = |sum: f64| (sum / total.particles.max(1) as f64).sqrt();
        RestReport {
            residual_before: mean(total.before),
            residual_after: mean(total.after),
            worst_after: total.worst,
            held: total.held,
            given_up: total.given_up,
        }
    }

    /// Rest lengths for a groom that was styled as the system was built and has settled to `rest_in_head`: first those that
    /// hold the style, which is what it settled under, then what is missing in the shape it settled to. `solids` are at
    /// rest in the head's frame, gravity is that of the head upright. Whoever steps the same strands does the same.
    ///
    /// Segments take the length they have settled to: what contact and strain limiting moved last has strained them by up to
    /// a twentieth, thousands of times what the hair's weight does, and would be carried for ever.
    ///
    /// Returns the state in equilibrium, upright: [`StrandState::carried`] takes it elsewhere. Another state of the same
    /// shape would have its perturbed particles where they are placed, not where the springs of bent hair hold them.
    ///
    /// # Errors
    /// [`crate::Error::RaggedPoints`] unless there are exactly the particles of this system.
    pub fn hold_settled(
        &mut self,
        rest_in_head: &[Vector3<f64>],
        solids: &[MovingSolid],
        params: &StepParams,
    ) -> Result<(StrandState, RestReport), crate::Error> {
        let upright = Isometry3::identity();
        let mut styled = self.rest_state(&upright);
        self.balance(&mut styled, &upright, solids, params);
        let mut settled = self.state_of_shape(rest_in_head, &upright)?;
        self.take_lengths(&settled);
        self.relax_perturbed(&mut settled, params);
        let report = self.balance(&mut settled, &upright, solids, params);
        Ok((settled, report))
    }

    /// Rest lengths of segments as they are in `state`.
    fn take_lengths(&mut self, state: &StrandState) {
        for (batch, state) in self.batches.iter_mut().zip(&state.batches) {
            let topology = &self.topologies[batch.topology];
            let ends = |j: usize| (topology.rig_of_main(j), topology.rig_of_main(j + 1));
            for j in 0..self.n_main - 1 {
                let (a, b) = ends(j);
                let Some(k) = topology.springs_to(b).find(|&k| topology.springs[k].a == a) else { continue };
                for l in 0..LANES {
                    let length = (get(&state.position[b], l) - get(&state.position[a], l)).norm();
                    if length > 0.0 {
                        batch.inv_rest_length[k][l] = 1.0 / length;
                    }
                }
            }
        }
    }

    fn balance_batch(
        &self,
        batch: &mut Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        work: &mut Work,
    ) -> Sums {
        let topology = &self.topologies[batch.topology];
        let lanes = batch.strands.len();
        self.find_supports(batch, state, input, params, work);
        let mut sums = Sums { particles: lanes * (topology.n_rig - topology.n_kinematic), ..Sums::default() };
        // Where the hair would end if it moved as the frozen springs let it.
        let mut shift = self.drift(batch, state, input, params, Tangent::Frozen, work);
        let before = self.residuals(batch, state, params, work, &shift);
        let styled = (batch.inv_rest_length.clone(), batch.altitude_rest.clone());
        for _ in 0..REFINEMENTS {
            // Edges are ten thousand times stiffer than bends: one solve leaves round-off that is not small to the weight.
            self.tighten(batch, &styled, state, &shift, 1.0, &[true; LANES], &mut [true; LANES]);
            let more = self.drift(batch, state, input, params, Tangent::Frozen, work);
            for (sum, more) in shift.iter_mut().zip(&more) {
                for c in 0..3 {
                    for l in 0..LANES {
                        sum[c][l] += more[c][l];
                    }
                }
            }
        }
        let supports = work.contacts.clone();
        work.hold_sideways();
        let mut share: [f64; LANES] = [0.0; LANES];
        for offered in SHARES {
            // Only lanes still without support are offered more.
            let open: [bool; LANES] = std::array::from_fn(|l| share[l] == 0.0);
            if !open.iter().any(|&o| o) {
                break;
            }
            let mut bearable = [true; LANES];
            self.tighten(batch, &styled, state, &shift, offered, &open, &mut bearable);
            self.drift(batch, state, input, params, Tangent::Full, work);
            for l in 0..LANES {
                if open[l] && bearable[l] && work.matrix.is_definite(l) {
                    share[l] = offered;
                }
            }
        }
        work.contacts = supports;
        // What no share suited keeps its styled rest lengths.
        let refused: [bool; LANES] = std::array::from_fn(|l| share[l] == 0.0);
        self.tighten(batch, &styled, state, &shift, 0.0, &refused, &mut [true; LANES]);
        let left = self.drift(batch, state, input, params, Tangent::Frozen, work);
        let after = self.residuals(batch, state, params, work, &left);
        for l in 0..lanes {
            // Springs exert a share of what would hold the strand, so the rest is missing. What the linear solve says of
            // contacts is no measure there: it lets the strand fall as far as frozen springs take it.
            let missing = 1.0 - share[l];
            let (sum, worst) =
                if missing == 0.0 { after[l] } else { (missing.powi(2) * before[l].0, missing * before[l].1) };
            sums.before += before[l].0;
            sums.after += sum;
            sums.worst = sums.worst.max(worst);
            if share[l] == 1.0 { sums.held += 1 } else { sums.given_up += 1 }
        }
        sums
    }

    /// Contacts of hair that lies on a solid, as supports that do not give.
    fn find_supports(
        &self,
        batch: &Batch,
        state: &mut BatchState,
        input: &StepInput,
        params: &StepParams,
        work: &mut Work,
    ) {
        work.contacts.clear();
        work.watched.clear();
        state.clearance.clear();
        let span = Span { begin: 0.0, end: 1.0, h: STATIC_S };
        self.find_contacts(batch, state, input, params, span, work);
        let mut lying: Vec<_> = work.contacts.drain(..).chain(work.watched.drain(..)).collect();
        lying.retain(|c| c.gap < LYING_CM);
        for contact in &mut lying {
            (contact.gap, contact.stiffness, contact.grip) = (0.0, SUPPORT, 0.0);
            contact.known = Vector3::zeros();
        }
        work.contacts = lying;
        work.sort_contacts();
        state.clearance.clear();
    }

    /// Displacement that the linear solve finds from `state`, per rig particle; of the frozen tangent, supports
    /// that would have to pull are let go for good.
    fn drift(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        params: &StepParams,
        tangent: Tangent,
        work: &mut Work,
    ) -> Vec<[Lane; 3]> {
        let topology = &self.topologies[batch.topology];
        let (n_kin, n_rig) = (topology.n_kinematic, topology.n_rig);
        let h = input.dt;
        let mut shift = vec![[ZERO; 3]; n_rig];
        loop {
            let rhs = &mut work.velocity[..3 * (n_rig - n_kin)];
            batch.fill_weight(n_kin, n_rig, &(params.gravity * h), rhs);
            let problem = Problem {
                topology,
                batch,
                start: &state.position,
                guess: None,
                kinematic: &shift[..n_kin],
                h,
                implicit: tangent.implicit(),
                drag_per_s: 0.0,
                air: &[],
                contacts: &work.contacts,
                driven: &[],
            };
            implicit::solve(&problem, &mut work.matrix, rhs);
            for p in n_kin..n_rig {
                for c in 0..3 {
                    for l in 0..LANES {
                        shift[p][c][l] = h * rhs[3 * (p - n_kin) + c][l];
                    }
                }
            }
            if tangent == Tangent::Full {
                return shift;
            }
            let n_supports = work.contacts.len();
            work.contacts.retain(|contact| {
                let along = |k: usize| contact.normal[k];
                let moved = |p: usize| (0..3).map(|k| along(k) * shift[p][k][contact.lane]).sum::<f64>();
                contact.weight[0] * moved(contact.ends[0]) + contact.weight[1] * moved(contact.ends[1]) <= 0.0
            });
            if work.contacts.len() == n_supports {
                return shift;
            }
        }
    }

    /// Sets the rest lengths of the `open` lanes so that springs exert a `share` of what `shift` would make them exert, on
    /// top of what they do; lanes in which one would change by too much are marked not `bearable`.
    fn tighten(
        &self,
        batch: &mut Batch,
        styled: &(Vec<Lane>, Vec<crate::altitude::AltitudeRestLanes>),
        state: &BatchState,
        shift: &[[Lane; 3]],
        share: f64,
        open: &[bool; LANES],
        bearable: &mut [bool; LANES],
    ) {
        let topology = &self.topologies[batch.topology];
        for (k, spring) in topology.springs.iter().enumerate() {
            let (a, b) = (&state.position[spring.a], &state.position[spring.b]);
            let stiffness = &batch.stiffness[spring.kind as usize];
            let s = linearise(a, b, stiffness, &styled.0[k], &ZERO, 1.0, Tangent::Frozen.implicit());
            for l in (0..LANES).filter(|&l| open[l]) {
                let d: [f64; 3] = std::array::from_fn(|c| s.direction[c][l]);
                let moved = || (0..3).map(|c| d[c] * (shift[spring.b][c][l] - shift[spring.a][c][l])).sum::<f64>();
                // Without a share the shift is not looked at: it need not be finite.
                let longer = if share == 0.0 { 0.0 } else { share * moved() };
                let length: f64 = (0..3).map(|c| d[c] * (b[c][l] - a[c][l])).sum();
                // The tension of the spring where it is, as a strain.
                let strain = length * styled.0[k][l] - 1.0 + longer * styled.0[k][l];
                batch.inv_rest_length[k][l] = (1.0 + strain) / length;
                bearable[l] &= (batch.inv_rest_length[k][l] / styled.0[k][l] - 1.0).abs() < LARGEST_CHANGE;
            }
        }
        for first in 0..topology.n_tetrahedra() {
            let x: [&[Lane; 3]; 4] = std::array::from_fn(|c| &state.position[first + c]);
            let s = altitude_lanes(x, &styled.1[first]);
            for l in (0..LANES).filter(|&l| open[l] && s.per_length[l] > 0.0) {
                let moved = |c: usize| (0..3).map(|k| s.direction[k][l] * shift[first + c][k][l]).sum::<f64>();
                let longer = || share * (0..4).map(|c| s.weight[c][l] * moved(c)).sum::<f64>();
                let untouched = share == 0.0 || s.rest_length[l] == 0.0;
                let change = if untouched { 0.0 } else { -longer() / s.rest_length[l] };
                for candidate in 0..crate::altitude::CANDIDATES {
                    batch.altitude_rest[first].length[candidate][l] =
                        styled.1[first].length[candidate][l] * (1.0 + change);
                }
                bearable[l] &= batch.stiffness[ALTITUDE][l] == 0.0 || change.abs() < LARGEST_CHANGE;
            }
        }
    }

    /// Sum of squares and largest of the residual over weight, per lane: the frozen system gives the net force back from
    /// the drift it causes.
    fn residuals(
        &self,
        batch: &Batch,
        state: &BatchState,
        params: &StepParams,
        work: &Work,
        shift: &[[Lane; 3]],
    ) -> [(f64, f64); LANES] {
        let topology = &self.topologies[batch.topology];
        let mut force = vec![[ZERO; 3]; topology.n_rig];
        for p in 0..topology.n_rig {
            for c in 0..3 {
                for l in 0..LANES {
                    force[p][c][l] = batch.mass[p][l] * params.gravity[c];
                }
            }
        }
        for (k, spring) in topology.springs.iter().enumerate() {
            let (a, b) = (&state.position[spring.a], &state.position[spring.b]);
            let stiffness = &batch.stiffness[spring.kind as usize];
            let s = linearise(a, b, stiffness, &batch.inv_rest_length[k], &ZERO, 1.0, Tangent::Frozen.implicit());
            for c in 0..3 {
                for l in 0..LANES {
                    force[spring.a][c][l] += s.force[c][l];
                    force[spring.b][c][l] -= s.force[c][l];
                }
            }
        }
        for first in 0..topology.n_tetrahedra() {
            let x: [&[Lane; 3]; 4] = std::array::from_fn(|c| &state.position[first + c]);
            let s = altitude_lanes(x, &batch.altitude_rest[first]);
            for l in 0..LANES {
                let pull = batch.stiffness[ALTITUDE][l] * s.per_length[l] * (s.length[l] - s.rest_length[l]);
                for c in 0..4 {
                    for k in 0..3 {
                        force[first + c][k][l] -= pull * s.weight[c][l] * s.direction[k][l];
                    }
                }
            }
        }
        for contact in &work.contacts {
            let along = |p: usize| (0..3).map(|k| contact.normal[k] * shift[p][k][contact.lane]).sum::<f64>();
            let moved = contact.weight[0] * along(contact.ends[0]) + contact.weight[1] * along(contact.ends[1]);
            for e in 0..2 {
                for k in 0..3 {
                    force[contact.ends[e]][k][contact.lane] -= SUPPORT * moved * contact.weight[e] * contact.normal[k];
                }
            }
        }
        let g2 = params.gravity.norm_squared().max(f64::MIN_POSITIVE);
        let mut out = [(0.0, 0.0_f64); LANES];
        for p in topology.n_kinematic..topology.n_rig {
            for l in 0..LANES {
                let f2: f64 = (0..3).map(|c| force[p][c][l].powi(2)).sum();
                let residual2 = f2 / (batch.mass[p][l].powi(2) * g2);
                out[l] = (out[l].0 + residual2, out[l].1.max(residual2.sqrt()));
            }
        }
        out
    }
}

impl Work {
    /// Adds to every support with friction two that hold across its normal: equilibrium is found without friction, so that
    /// whatever disturbs it a little meets a contact that sticks. Without them hair on a head could slide off either way.
    fn hold_sideways(&mut self) {
        for k in 0..self.contacts.len() {
            let contact = self.contacts[k];
            if contact.friction > 0.0 {
                let axis = if contact.normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::z() };
                let aside = contact.normal.cross(&axis).normalize();
                let normals = [aside, contact.normal.cross(&aside)];
                self.contacts.extend(normals.map(|normal| Contact { normal, ..contact }));
            }
        }
        self.sort_contacts();
    }
}

/// Stiffness of a support, dyn/cm: far above the hair's, so that it does not give.
const SUPPORT: f64 = 1e3;

/// Which stiffness the linear solve uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tangent {
    /// Directions frozen: exact in the force it balances.
    Frozen,
    /// Turning included, of springs under compression too: its sign decides on stability.
    Full,
}

impl Tangent {
    fn implicit(self) -> Implicit {
        match self {
            Self::Frozen => Implicit { elastic: 1.0, geometric: 0.0, least_tension: 0.0 },
            Self::Full => Implicit { elastic: 1.0, geometric: 1.0, least_tension: f64::NEG_INFINITY },
        }
    }
}
