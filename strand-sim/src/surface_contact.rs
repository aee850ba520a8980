//! No strand goes through a surface within a substep: the last word after contact with distance fields, which sees where
//! hair ends but not what it went through.
//!
//! Every segment whose way may meet a surface is followed exactly (`collision::ccd`). One that touches is held off the
//! touched place, carried along with the solid, by moving its two ends; what moved is followed again. Then
//! runs of segments that still touch stop relative to the solid where they met it, and at last the strand only gives way. Invariant: with nothing unresolved in the
//! report, no segment that was free at the start met a surface on its way. MS08 §5.1.

use crate::lanes::{LANES, Lane3};
use crate::step::{Span, StepInput, Work};
use crate::system::{Batch, BatchState, StrandSystem, get, set};
use collision::SolidPose;
use collision::ccd::{SurfaceHit, first_touch};
use collision::segment_pair::Sweep;
use collision::surface::Surface;
use nalgebra::{Point3, Vector3};

/// Distance that counts as a touch, cm: a hundredth of a millimetre, an eighth of a hair.
const TOUCH_CM: f64 = 1e-3;

/// Distance left between a segment and the place it was held off, cm.
const CLEARANCE_CM: f64 = 3.0 * TOUCH_CM;

/// Share of the distance at the start at which a segment that starts nearer than a touch is taken to touch.
const SHARE_OF_START: f64 = 0.5;

/// Share of the way to the surface that what is stopped still goes: at its very end it would be found touching again.
const SHARE_OF_WAY: f64 = 0.75;

/// Distance at the start below which a segment is in the surface for all that can be told, cm. Hair that is squeezed comes
/// nearer by a share of its distance from substep to substep, so this is near what round-off leaves of one.
const LEAST_CM: f64 = 1e-10;

/// Sweeps of the first try, and how many of them hold segments off before runs of segments are stopped.
const SWEEPS: usize = 32;
const PUSHES: usize = 8;

/// Sweeps of the second try, of a strand that does nothing but give way, and how many of them hold segments off.
const STILL_SWEEPS: usize = 48;
const STILL_PUSHES: usize = 40;

const ALL_SWEEPS: usize = SWEEPS + STILL_SWEEPS;

/// What following the strands of a batch came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SurfaceReport {
    /// Touches answered.
    pub answered: u32,
    /// Segments that still go through when sweeps ran out.
    pub unresolved: u32,
    /// Strands that have such segments, a bit for each lane.
    pub passing: u8,
}

impl SurfaceReport {
    /// What both have seen.
    pub fn and(self, other: Self) -> Self {
        Self {
            answered: self.answered + other.answered,
            unresolved: self.unresolved + other.unresolved,
            passing: self.passing | other.passing,
        }
    }
}

/// Buffers for one strand.
#[derive(Debug, Default)]
pub(crate) struct SurfaceWork {
    before: Vec<Vector3<f64>>,
    after: Vec<Vector3<f64>>,
    inv_mass: Vec<f64>,
    /// Per segment: to be followed (again).
    pending: Vec<bool>,
    /// Per segment: when it met the surface in this sweep, if it could not be held off, and the way out (world).
    touched_at: Vec<(f64, Vector3<f64>)>,
    /// Per particle: goes on with the solid.
    zone: Vec<bool>,
}

impl StrandSystem {
    /// Changes where a substep leads so that no segment goes through a surface on its straight way there; of the strands
    /// in `lanes`, a bit each.
    pub(crate) fn stop_at_surfaces(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        span: Span,
        lanes: u8,
        work: &mut Work,
    ) -> SurfaceReport {
        let topology = &self.topologies[batch.topology];
        let mut report = SurfaceReport::default();
        let way = box_around(&state.position, &work.next[..topology.n_rig]);
        for body in input.surfaces {
            let pose = SolidPose { from: body.pose.at(span.begin), to: body.pose.at(span.end) };
            let bounds = body.surface.bounds_over(&pose);
            if !boxes_meet(&way, &bounds) {
                continue;
            }
            for lane in (0..batch.strands.len()).filter(|lane| lanes >> lane & 1 != 0) {
                let strand = &mut work.surface;
                strand.before.clear();
                strand.after.clear();
                for i in 0..self.n_main {
                    let p = topology.rig_of_main(i);
                    strand.before.push(get(&state.position[p], lane));
                    strand.after.push(get(&work.next[p], lane));
                }
                if !strand.may_meet(&bounds) {
                    continue;
                }
                strand.inv_mass.clear();
                for i in 0..self.n_main {
                    let p = topology.rig_of_main(i);
                    let is_driven = work.driven.iter().any(|d| d.particle == p && d.lane == lane);
                    let is_free = p >= topology.n_kinematic && !is_driven;
                    strand.inv_mass.push(if is_free { 1.0 / batch.mass[p][lane] } else { 0.0 });
                }
                let found = strand.hold_off(body.surface, &pose);
                report = report.and(SurfaceReport { passing: u8::from(found.unresolved > 0) << lane, ..found });
                if found.answered > 0 {
                    self.take_over(batch, lane, span.h, work);
                }
            }
        }
        report
    }

    /// Puts changed ends back; perturbed particles follow the two they stand between, velocities the positions.
    fn take_over(&self, batch: &Batch, lane: usize, h: f64, work: &mut Work) {
        let topology = &self.topologies[batch.topology];
        let mut moved_before = Vector3::zeros();
        for i in 0..self.n_main {
            let p = topology.rig_of_main(i);
            let moved = work.surface.after[i] - get(&work.next[p], lane);
            work.shift(p, lane, moved, h);
            if let Some(q) =
                i.checked_sub(1).and_then(|j| topology.rig_of_perturbed(j)).filter(|&q| q >= topology.n_kinematic)
            {
                work.shift(q, lane, (moved_before + moved) * 0.5, h);
            }
            moved_before = moved;
        }
    }
}

impl Work {
    fn shift(&mut self, p: usize, lane: usize, by: Vector3<f64>, h: f64) {
        if by != Vector3::zeros() {
            let x = get(&self.next[p], lane) + by;
            set(&mut self.next[p], lane, x);
            let v = get(&self.next_velocity[p], lane) + by / h;
            set(&mut self.next_velocity[p], lane, v);
        }
    }
}

impl SurfaceWork {
    fn sweep(&self, i: usize) -> Sweep {
        Sweep { start: [self.before[i], self.before[i + 1]], end: [self.after[i], self.after[i + 1]] }
    }

    /// Marks the segments whose way comes into a box (world, cm), and says whether there is one.
    fn may_meet(&mut self, [low, high]: &[Vector3<f64>; 2]) -> bool {
        self.pending.clear();
        let mut any = false;
        for i in 0..self.before.len() - 1 {
            let points = [self.before[i], self.before[i + 1], self.after[i], self.after[i + 1]];
            let is_near = (0..3).all(|c| {
                points.iter().any(|p| p[c] >= low[c] - TOUCH_CM) && points.iter().any(|p| p[c] <= high[c] + TOUCH_CM)
            });
            self.pending.push(is_near);
            any |= is_near;
        }
        any
    }

    fn hold_off(&mut self, surface: &Surface, pose: &SolidPose) -> SurfaceReport {
        let mut report = SurfaceReport::default();
        self.zone.clear();
        self.zone.resize(self.before.len(), false);
        for sweep in 0..=ALL_SWEEPS {
            if sweep == SWEEPS {
                self.stand_still();
            }
            let pushes = if sweep < SWEEPS { sweep < PUSHES } else { sweep < SWEEPS + STILL_PUSHES };
            let mut touches = 0;
            self.touched_at.clear();
            self.touched_at.resize(self.pending.len(), (f64::INFINITY, Vector3::zeros()));
            for i in 0..self.pending.len() {
                if !std::mem::take(&mut self.pending[i]) || self.inv_mass[i] + self.inv_mass[i + 1] <= 0.0 {
                    continue;
                }
                let way = self.sweep(i);
                let Some(touch) = touch_distance(surface, pose, &way) else { continue };
                let Some(hit) = first_touch(surface, pose, &way, touch) else { continue };
                touches += 1;
                if sweep == ALL_SWEEPS {
                    report.unresolved += 1;
                } else if !pushes || !self.push_off(i, &hit, pose) {
                    self.touched_at[i] = (hit.time, pose.to.rotation * hit.normal);
                    (self.zone[i], self.zone[i + 1]) = (true, true);
                }
                // Both ends are the neighbours' too.
                for k in i.saturating_sub(1)..(i + 2).min(self.pending.len()) {
                    self.pending[k] = true;
                }
            }
            if touches == 0 || sweep == ALL_SWEEPS {
                break;
            }
            report.answered += touches;
            self.stop_zones(pose, sweep);
        }
        report
    }

    /// Takes back what the strand would have done by itself: hair stretched far over a tooth is drawn into it again and again.
    fn stand_still(&mut self) {
        for (p, zone) in self.zone.iter_mut().enumerate() {
            *zone = false;
            if self.inv_mass[p] > 0.0 {
                self.after[p] = self.before[p];
            }
        }
        self.pending.fill(true);
    }

    /// The place touched goes on with the solid; the segment's place there ends clear of it. Says whether that was any
    /// help: not if the segment went round the place and met it from elsewhere, or if only held ends could give way.
    fn push_off(&mut self, i: usize, hit: &SurfaceHit, pose: &SolidPose) -> bool {
        let normal = pose.to.rotation * hit.normal;
        let touched = (pose.to * Point3::from(hit.point)).coords;
        let weights = [1.0 - hit.s, hit.s];
        let place = self.after[i] * weights[0] + self.after[i + 1] * weights[1];
        let missing = CLEARANCE_CM - normal.dot(&(place - touched));
        let inv_mass: f64 = (0..2).map(|e| weights[e] * weights[e] * self.inv_mass[i + e]).sum();
        if missing <= 0.0 || inv_mass <= 0.0 {
            return false;
        }
        for e in 0..2 {
            self.after[i + e] += normal * (missing * weights[e] * self.inv_mass[i + e] / inv_mass);
        }
        true
    }

    /// From the first time that any of its segments met the surface, each run of particles that could not be held off goes
    /// on with the solid. What the solid sees of their way is the part before that, which was free: the impact zones of
    /// Bridson 2002 §7.5, of one strand and a solid. Beside a solid that turns even who goes on with it moves, by the height
    /// of the arc, so they are also taken a little way out.
    fn stop_zones(&mut self, pose: &SolidPose, sweep: usize) {
        let n = self.zone.len();
        // In a corner one length of that little way leads into the other side, another does not.
        let out = CLEARANCE_CM * 0.5_f64.powi((sweep % 8) as i32);
        let mut first = 0;
        while first < n {
            let end = (first..n).find(|&p| !self.zone[p]).unwrap_or(n);
            let segments = &self.touched_at[first..end.saturating_sub(1).max(first)];
            let earliest =
                segments.iter().fold((f64::INFINITY, Vector3::zeros()), |a, b| if b.0 < a.0 { *b } else { a });
            if earliest.0 <= 1.0 {
                let time = SHARE_OF_WAY * earliest.0;
                let carried = pose.to * pose.at(time).inverse();
                for p in (first..end).filter(|&p| self.inv_mass[p] > 0.0) {
                    let met = self.before[p].lerp(&self.after[p], time);
                    self.after[p] = (carried * Point3::from(met)).coords + earliest.1 * out;
                }
                for k in first.saturating_sub(1)..end.min(n - 1) {
                    self.pending[k] = true;
                }
            }
            first = end + 1;
        }
    }
}

/// Box around all lanes of a batch at both ends of a substep, cm. Numbers that are not finite meet nothing.
fn box_around(before: &[Lane3], after: &[Lane3]) -> [Vector3<f64>; 2] {
    let (mut low, mut high) = ([[f64::INFINITY; LANES]; 3], [[f64::NEG_INFINITY; LANES]; 3]);
    for x in before.iter().chain(after) {
        for c in 0..3 {
            for l in 0..LANES {
                low[c][l] = low[c][l].min(x[c][l]);
                high[c][l] = high[c][l].max(x[c][l]);
            }
        }
    }
    let least = low.map(|of| of.into_iter().fold(f64::INFINITY, f64::min));
    let most = high.map(|of| of.into_iter().fold(f64::NEG_INFINITY, f64::max));
    [least.into(), most.into()]
}

/// Whether two boxes come within a touch of each other.
fn boxes_meet(a: &[Vector3<f64>; 2], b: &[Vector3<f64>; 2]) -> bool {
    (0..3).all(|c| a[0][c] <= b[1][c] + TOUCH_CM && b[0][c] <= a[1][c] + TOUCH_CM)
}

/// Distance that counts as a touch for a segment: less than it starts at. None for one that starts in the surface, which
/// contact with the distance field is for.
fn touch_distance(surface: &Surface, pose: &SolidPose, way: &Sweep) -> Option<f64> {
    let start = way.start.map(|x| pose.from.inverse_transform_point(&Point3::from(x)).coords);
    let distance = surface.distance_within(&start, TOUCH_CM / SHARE_OF_START);
    (distance > LEAST_CM).then(|| (SHARE_OF_START * distance).min(TOUCH_CM))
}
