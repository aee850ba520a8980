//! Bodies that deform: a distance field for each key frame, and where the body stands in time over a step (MS08 §5.1).
//!
//! Keys share their triangles; between them the surface is carried by two-sided interpolation ([`crate::sdf::advect`]).
//! Before the first key and after the last the body stands still. A rigid pose may carry all of it, as a head carries a
//! face: the less the keys move in the body's own frame, the better the interpolation.

use nalgebra::{Point3, Vector3};
use parry3d::shape::TriMesh;

use crate::body::MovingBody;
use crate::error::Error;
use crate::sdf::advect::DeformedField;
use crate::sdf::mesh::ClosedMesh;
use crate::sdf::mesh_bake::bake_closed;
use crate::sdf::shift::ShiftField;
use crate::sdf::{BakeParams, Bounds, DistanceField, SignedDistanceField};
use crate::solid::SolidPose;
use crate::thickness::smallest_half_thickness;

/// Cells of a key's field across a cell of the motion: a smooth motion needs no more.
const FIELD_CELLS_PER_MOTION_CELL: f32 = 4.0;

/// A mesh with its positions at several times.
#[derive(Debug, Clone, Copy)]
pub struct KeyedMesh<'a> {
    /// Time of each key, s, increasing.
    pub times_s: &'a [f64],
    /// Vertex positions at each key in the body's frame, cm.
    pub positions: &'a [Vec<[f32; 3]>],
    /// Triangles of every key, counter-clockwise from outside.
    pub triangles: &'a [[u32; 3]],
}

/// A body that deforms from key frame to key frame, in its own frame.
#[derive(Debug, Clone)]
pub struct DeformingSolid {
    /// Name, for reports.
    pub name: String,
    /// Half the thickness of its thinnest feature at any key, cm.
    pub half_thickness_cm: f32,
    /// Coulomb friction coefficient against hair.
    pub friction: f32,
    times_s: Vec<f64>,
    keys: Vec<SignedDistanceField>,
    /// One for each two successive keys.
    motions: Vec<Motion>,
    bounds: Bounds,
    /// Half the longest way of a surface point between two successive keys, cm.
    slack: f32,
}

/// What happens between two successive keys.
#[derive(Debug, Clone)]
struct Motion {
    shift: ShiftField,
    /// Longest way of any surface point, cm.
    longest: f32,
}

impl DeformingSolid {
    /// Bakes every key of a mesh and the motion between them.
    ///
    /// # Errors
    /// Fewer than two keys, times that do not increase, keys of different sizes, and for each key as
    /// [`crate::bake_from_mesh`], with the key named.
    pub fn from_keys(name: &str, mesh: KeyedMesh, params: BakeParams, friction: f32) -> Result<Self, Error> {
        check_keys(&mesh)?;
        let mut closed = Vec::with_capacity(mesh.positions.len());
        let mut keys = Vec::with_capacity(mesh.positions.len());
        for (key, positions) in mesh.positions.iter().enumerate() {
            let named = |e| Error::BadKey { key, source: Box::new(e) };
            let surface = ClosedMesh::new(positions, mesh.triangles).map_err(named)?;
            keys.push(bake_closed(&surface, params).map_err(named)?);
            closed.push(surface.indexed().map_err(named)?);
        }
        let mut motions = Vec::with_capacity(keys.len() - 1);
        for n in 0..keys.len() - 1 {
            let ends = [&mesh.positions[n], &mesh.positions[n + 1]];
            let motion = bake_motion(ends, [&closed[n], &closed[n + 1]], [&keys[n], &keys[n + 1]], params.max_bytes);
            motions.push(motion.map_err(|e| Error::BadKey { key: n, source: Box::new(e) })?);
        }
        let bounds = keys.iter().map(SignedDistanceField::bounds).reduce(join);
        let bounds = bounds.ok_or(Error::TooFewKeys { n_keys: 0 })?;
        Ok(Self {
            name: name.to_owned(),
            half_thickness_cm: closed.iter().map(smallest_half_thickness).fold(f32::INFINITY, f32::min),
            friction,
            times_s: mesh.times_s.to_vec(),
            keys,
            slack: 0.5 * motions.iter().map(|m| m.longest).fold(0.0, f32::max),
            motions,
            bounds,
        })
    }

    /// Times of the keys, s.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// The distance fields of the keys.
    pub fn keys(&self) -> &[SignedDistanceField] {
        &self.keys
    }

    /// A box that holds the body at every time.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Bytes held by fields and motions.
    pub fn memory_bytes(&self) -> usize {
        self.keys.iter().map(SignedDistanceField::memory_bytes).sum::<usize>()
            + self.motions.iter().map(|m| m.shift.memory_bytes()).sum::<usize>()
    }

    /// The body at a time, s.
    pub fn at(&self, time_s: f64) -> DeformedField<'_> {
        let n = self.motion_at(time_s);
        let (begin, end) = (self.times_s[n], self.times_s[n + 1]);
        DeformedField {
            earlier: &self.keys[n],
            later: &self.keys[n + 1],
            shift: &self.motions[n].shift,
            longest: self.motions[n].longest,
            slack: self.slack,
            a: ((time_s - begin) / (end - begin)).clamp(0.0, 1.0) as f32,
        }
    }

    /// Velocity (cm/s) of what is at `p` (body's frame) at a time; zero before the first key and after the last.
    pub fn velocity(&self, p: Vector3<f32>, time_s: f64) -> Vector3<f32> {
        let (first, last) = (self.times_s[0], self.times_s[self.times_s.len() - 1]);
        if !(time_s > first && time_s <= last) {
            return Vector3::zeros();
        }
        let n = self.motion_at(time_s);
        self.motions[n].shift.at(p) / (self.times_s[n + 1] - self.times_s[n]) as f32
    }

    /// Highest speed (cm/s) of any surface point at any time between two.
    pub fn max_speed(&self, from_s: f64, to_s: f64) -> f64 {
        (0..self.motions.len())
            .filter(|&n| self.times_s[n] < to_s && self.times_s[n + 1] > from_s)
            .map(|n| f64::from(self.motions[n].longest) / (self.times_s[n + 1] - self.times_s[n]))
            .fold(0.0, f64::max)
    }

    /// The motion under way at a time; at a key, the one that ends there.
    fn motion_at(&self, time_s: f64) -> usize {
        self.times_s.partition_point(|&t| t < time_s).saturating_sub(1).min(self.motions.len() - 1)
    }
}

/// A deforming body on its way through one step.
#[derive(Debug, Clone, Copy)]
pub struct MovingDeformingSolid<'a> {
    /// What moves.
    pub solid: &'a DeformingSolid,
    /// What carries it.
    pub pose: SolidPose,
    /// Time on the body's own clock at the start of the step, s.
    pub from_s: f64,
    /// Time on the body's own clock at its end, s; not before `from_s`.
    pub to_s: f64,
}

impl MovingDeformingSolid<'_> {
    fn time_at(&self, alpha: f64) -> f64 {
        self.from_s + alpha * (self.to_s - self.from_s)
    }

    /// Signed distance (cm) at a world point with the body where it stands at a fraction of the step.
    pub fn distance_at(&self, point: Vector3<f64>, alpha: f64) -> f32 {
        let p = self.pose.at(alpha).inverse_transform_point(&Point3::from(point));
        self.field_at(alpha).distance(p.coords.cast())
    }
}

impl MovingBody for MovingDeformingSolid<'_> {
    fn pose(&self) -> &SolidPose {
        &self.pose
    }

    fn field_at(&self, alpha: f64) -> impl DistanceField {
        self.solid.at(self.time_at(alpha))
    }

    fn half_thickness_cm(&self) -> f32 {
        self.solid.half_thickness_cm
    }

    fn friction(&self) -> f32 {
        self.solid.friction
    }

    fn max_displacement(&self) -> f64 {
        let deforming = self.solid.max_speed(self.from_s, self.to_s) * (self.to_s - self.from_s);
        self.pose.max_displacement(&self.solid.bounds) + deforming
    }

    fn velocity_at(&self, point: Vector3<f64>, alpha: f64, dt: f64) -> Vector3<f64> {
        if dt <= 0.0 {
            return Vector3::zeros();
        }
        let world_from_solid = self.pose.at(alpha);
        let p = world_from_solid.inverse_transform_point(&Point3::from(point));
        let own = self.solid.velocity(p.coords.cast(), self.time_at(alpha)).cast::<f64>();
        // The body's clock need not run as the step's does.
        let rate = (self.to_s - self.from_s) / dt;
        self.pose.velocity_at(point, dt) + world_from_solid.rotation * own * rate
    }
}

fn bake_motion(
    positions: [&Vec<[f32; 3]>; 2],
    surfaces: [&TriMesh; 2],
    keys: [&SignedDistanceField; 2],
    max_bytes: usize,
) -> Result<Motion, Error> {
    let [earlier, later] = positions;
    let shift: Vec<_> = earlier.iter().zip(later).map(|(a, b)| Vector3::from(*b) - Vector3::from(*a)).collect();
    let cell = FIELD_CELLS_PER_MOTION_CELL * keys[0].cell().min(keys[1].cell());
    Ok(Motion {
        shift: ShiftField::bake(&surfaces, &shift, join(keys[0].bounds(), keys[1].bounds()), cell, max_bytes)?,
        longest: shift.iter().map(Vector3::norm).fold(0.0, f32::max),
    })
}

fn check_keys(mesh: &KeyedMesh) -> Result<(), Error> {
    let (n_keys, n_times) = (mesh.positions.len(), mesh.times_s.len());
    if n_keys < 2 {
        return Err(Error::TooFewKeys { n_keys });
    }
    if n_keys != n_times {
        return Err(Error::KeyTimes { n_keys, n_times });
    }
    for (key, pair) in mesh.times_s.windows(2).enumerate() {
        let increasing = pair[0].is_finite() && pair[1].is_finite() && pair[0] < pair[1];
        if !increasing {
            return Err(Error::UnorderedKeys { key: key + 1, time_s: pair[1], before_s: pair[0] });
        }
    }
    let expected = mesh.positions[0].len();
    match mesh.positions.iter().position(|p| p.len() != expected) {
        Some(key) => Err(Error::RaggedKey { key, n_vertices: mesh.positions[key].len(), expected }),
        None => Ok(()),
    }
}

fn join(a: Bounds, b: Bounds) -> Bounds {
    Bounds::new(a.min.inf(&b.min), a.max.sup(&b.max))
}
