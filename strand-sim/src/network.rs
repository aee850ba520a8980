//! Mass-spring networks of meshes: volumes of tetrahedra and thin shells with altitude springs (MS08 §3.1, Fig. 4, 5).
//!
//! Hair has its own banded solver; this is the general case on which the altitude spring shows that a body collapsed to a
//! plane, or turned inside out, finds its shape again. Time integration is that of the strands: backward Euler, linear
//! because directions are frozen over the step (MS08 §4.1). Every sum runs in the order of the elements, so a step gives
//! the same bytes each time.

pub mod primitives;
mod solve;

use crate::altitude::{AltitudeRest, altitude};
use crate::error::Error;
use nalgebra::Vector3;
use solve::{Element, Solver};
use std::collections::BTreeMap;

/// Volume of a tetrahedron, as a share of its longest edge cubed, below which it counts as flat and is refused.
const FLAT: f64 = 1e-6;

/// Contact with the floor, as a multiple of mass over dt²: a particle falling onto it ends the step with this reciprocal
/// of its penetration.
const FLOOR_STIFFNESS: f64 = 1e3;

/// Passes in which floor contacts are added and released within a step.
const CONTACT_PASSES: usize = 6;

/// Constants of a network. Stiffness is the force at strain one; damping acts on the rate of change of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkMaterial {
    /// Springs on the mesh's edges, dyn.
    pub edge_dyn: f64,
    /// Springs between the two corners opposite an edge of a shell, dyn.
    pub bend_dyn: f64,
    /// Altitude springs, dyn.
    pub altitude_dyn: f64,
    /// Damping of every spring, dyn·s/cm.
    pub damping: f64,
    /// Mass per volume of a tetrahedral mesh, g/cm³, or per area of a shell, g/cm².
    pub density: f64,
}

/// How altitude springs take part in a step. The last two exist to show what the first is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AltitudeMode {
    /// Signed lengths: an inverted tetrahedron is pulled back through its plane.
    Signed,
    /// Lengths without sign: an inverted tetrahedron is content with its mirror image.
    Unsigned,
    /// No altitude springs: what is flat stays flat.
    Off,
}

/// How a step is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkParams {
    /// Acceleration of gravity, cm/s².
    pub gravity: Vector3<f64>,
    /// Whether the plane y = 0 is a frictionless floor.
    pub floor: bool,
    /// Adds max(T, 0)/l (I - ddᵀ), without which taut springs bound the step (docs/DEVIATIONS.md).
    pub geometric_stiffness: bool,
    /// Altitude springs.
    pub altitudes: AltitudeMode,
    /// Residual of the linear solve, relative to its right side.
    pub tolerance: f64,
    /// Most iterations of one linear solve.
    pub max_iterations: usize,
}

impl NetworkParams {
    /// Standard gravity along -y on a floor, geometric and signed altitude stiffness.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            gravity: Vector3::new(0.0, -981.0, 0.0),
            floor: true,
            geometric_stiffness: true,
            altitudes: AltitudeMode::Signed,
            tolerance: 1e-8,
            max_iterations: 2000,
        }
    }
}

/// A spring along an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EdgeSpring {
    ends: [usize; 2],
    bends: bool,
    rest_length: f64,
}

/// An altitude spring's tetrahedron.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tetrahedron {
    corners: [usize; 4],
    rest: AltitudeRest,
}

/// Particles joined by springs.
#[derive(Clone, Debug)]
pub struct Network {
    material: NetworkMaterial,
    mass: Vec<f64>,
    fixed: Vec<bool>,
    springs: Vec<EdgeSpring>,
    tetrahedra: Vec<Tetrahedron>,
}

/// Positions (cm) and velocities (cm/s) of a network's particles.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkState {
    /// cm.
    pub position: Vec<Vector3<f64>>,
    /// cm/s.
    pub velocity: Vec<Vector3<f64>>,
}

impl NetworkState {
    /// Particles at rest at given places, cm.
    #[must_use]
    pub fn still(position: &[Vector3<f64>]) -> Self {
        Self { position: position.to_vec(), velocity: vec![Vector3::zeros(); position.len()] }
    }
}

/// What a step met.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkReport {
    /// Iterations of all linear solves.
    pub iterations: usize,
    /// Whether the last solve reached the tolerance.
    pub converged: bool,
    /// Particles on the floor.
    pub contacts: usize,
    /// Altitude springs in force.
    pub altitudes: usize,
}

/// Buffers of a step, reused from step to step.
#[derive(Debug, Default)]
pub struct NetworkWorkspace {
    elements: Vec<Element>,
    force: Vec<Vector3<f64>>,
    rhs: Vec<Vector3<f64>>,
    solution: Vec<Vector3<f64>>,
    touching: Vec<bool>,
    solver: Solver,
}

impl Network {
    /// Edge springs on all distinct edges of a tetrahedral mesh and an altitude spring in every tetrahedron, unstressed at
    /// `points` (cm). Corners may be listed in either orientation.
    ///
    /// # Errors
    /// Constants out of range, a point that is not finite, an index past the points, a tetrahedron without volume.
    pub fn tetrahedral_mesh(
        points: &[Vector3<f64>],
        tetrahedra: &[[u32; 4]],
        material: NetworkMaterial,
    ) -> Result<Self, Error> {
        let mut network = Self::of_points(points, material)?;
        let mut edges = BTreeMap::new();
        for (element, indices) in tetrahedra.iter().enumerate() {
            let corners = checked(indices, points.len(), element)?;
            let x = corners.map(|c| points[c]);
            let volume = (x[1] - x[0]).dot(&(x[2] - x[0]).cross(&(x[3] - x[0]))) / 6.0;
            let mut longest = 0.0_f64;
            for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
                longest = longest.max((x[j] - x[i]).norm());
                edges.insert(ordered(corners[i], corners[j]), false);
            }
            if volume.abs() <= FLAT * longest.powi(3) {
                return Err(Error::FlatTetrahedron { tetrahedron: element, volume_cm3: volume, longest_cm: longest });
            }
            for c in corners {
                network.mass[c] += material.density * volume.abs() / 4.0;
            }
            network.tetrahedra.push(Tetrahedron { corners, rest: AltitudeRest::new(&x) });
        }
        network.join(points, edges)?;
        Ok(network)
    }

    /// Edge springs on a triangle mesh and, at every edge shared by two triangles, a bending spring between the opposite
    /// corners and the altitude spring of the four (MS08 Fig. 5), unstressed at `points` (cm).
    ///
    /// # Errors
    /// Constants out of range, a point that is not finite, an index past the points, a triangle without area, an edge of
    /// more than two triangles.
    pub fn thin_shell(
        points: &[Vector3<f64>],
        triangles: &[[u32; 3]],
        material: NetworkMaterial,
    ) -> Result<Self, Error> {
        let mut network = Self::of_points(points, material)?;
        let mut opposite: BTreeMap<[usize; 2], Vec<usize>> = BTreeMap::new();
        for (element, indices) in triangles.iter().enumerate() {
            let corners = checked(indices, points.len(), element)?;
            let [a, b, c] = corners.map(|c| points[c]);
            let (u, v) = (b - a, c - a);
            let area = u.cross(&v).norm() / 2.0;
            if area <= FLAT * u.norm_squared().max(v.norm_squared()) {
                return Err(Error::FlatTriangle { triangle: element, area_cm2: area });
            }
            for k in 0..3 {
                network.mass[corners[k]] += material.density * area / 3.0;
                let edge = ordered(corners[k], corners[(k + 1) % 3]);
                opposite.entry(edge).or_default().push(corners[(k + 2) % 3]);
            }
        }
        let mut edges: BTreeMap<[usize; 2], bool> = opposite.keys().map(|&e| (e, false)).collect();
        for (&[a, b], corners) in &opposite {
            match corners[..] {
                [_] => {}
                [c, d] if c != d => {
                    edges.entry(ordered(c, d)).or_insert(true);
                    let corners = [a, b, c, d];
                    let rest = AltitudeRest::new(&corners.map(|p| points[p]));
                    network.tetrahedra.push(Tetrahedron { corners, rest });
                }
                _ => return Err(Error::CrowdedEdge { a, b, n_triangles: corners.len() }),
            }
        }
        network.join(points, edges)?;
        Ok(network)
    }

    fn of_points(points: &[Vector3<f64>], material: NetworkMaterial) -> Result<Self, Error> {
        material.validate()?;
        if let Some(point) = points.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            return Err(Error::NonFinitePoint { point });
        }
        Ok(Self {
            material,
            mass: vec![0.0; points.len()],
            fixed: vec![false; points.len()],
            springs: Vec::new(),
            tetrahedra: Vec::new(),
        })
    }

    fn join(&mut self, points: &[Vector3<f64>], edges: BTreeMap<[usize; 2], bool>) -> Result<(), Error> {
        if let Some(point) = self.mass.iter().position(|&m| m <= 0.0) {
            return Err(Error::LoosePoint { point });
        }
        for (ends, bends) in edges {
            let rest_length = (points[ends[1]] - points[ends[0]]).norm();
            if rest_length <= 0.0 {
                return Err(Error::CoincidentPoints { a: ends[0], b: ends[1] });
            }
            self.springs.push(EdgeSpring { ends, bends, rest_length });
        }
        Ok(())
    }

    /// Particles.
    #[must_use]
    pub fn n_particles(&self) -> usize {
        self.mass.len()
    }

    /// Mass per particle, g.
    #[must_use]
    pub fn masses(&self) -> &[f64] {
        &self.mass
    }

    /// Constants in force.
    #[must_use]
    pub fn material(&self) -> &NetworkMaterial {
        &self.material
    }

    /// Replaces the stiffnesses and the damping; masses stay.
    ///
    /// # Errors
    /// [`Error::BadMaterial`] names the first constant out of range.
    pub fn set_material(&mut self, material: NetworkMaterial) -> Result<(), Error> {
        material.validate()?;
        self.material = material;
        Ok(())
    }

    /// Holds a particle where it is, or lets it go.
    ///
    /// # Errors
    /// [`Error::UnknownPoint`] for an index past the particles.
    pub fn set_fixed(&mut self, particle: usize, fixed: bool) -> Result<(), Error> {
        let n_points = self.fixed.len();
        let slot = self.fixed.get_mut(particle).ok_or(Error::UnknownPoint { element: 0, point: particle, n_points })?;
        *slot = fixed;
        Ok(())
    }

    /// Signed volume of every altitude spring's tetrahedron relative to its rest volume's sign, cm³: negative is inverted.
    pub fn volumes(&self, position: &[Vector3<f64>]) -> impl Iterator<Item = f64> {
        self.tetrahedra.iter().map(|t| {
            let x = t.corners.map(|c| position[c]);
            let volume = (x[1] - x[0]).dot(&(x[2] - x[0]).cross(&(x[3] - x[0]))) / 6.0;
            if t.rest.length[0] < 0.0 { -volume } else { volume }
        })
    }

    /// Advances `state` by one step of `dt` seconds.
    /// Implements MS08 §4.1: (M + Σ (h·b + h²·k/l0) A Aᵀ) v' = M v + h F, A the frozen direction of each spring.
    ///
    /// # Panics
    /// If `state` is not one of this network.
    pub fn step(
        &self,
        state: &mut NetworkState,
        dt: f64,
        params: &NetworkParams,
        workspace: &mut NetworkWorkspace,
    ) -> NetworkReport {
        let n = self.mass.len();
        assert!(state.position.len() == n && state.velocity.len() == n, "state of another network");
        let mut report = NetworkReport::default();
        self.linearise(&state.position, dt, params, workspace, &mut report);
        let w = workspace;
        w.touching.resize(n, false);
        w.solution.clear();
        w.solution.extend_from_slice(&state.velocity);
        for _ in 0..CONTACT_PASSES {
            w.rhs.clear();
            for p in 0..n {
                let mut rhs = state.velocity[p] * self.mass[p] + w.force[p] * dt;
                if w.touching[p] {
                    rhs.y -= FLOOR_STIFFNESS * self.mass[p] / dt * state.position[p].y;
                }
                w.rhs.push(rhs);
            }
            let contact = FLOOR_STIFFNESS;
            let diagonal = |p: usize| {
                let m = self.mass[p];
                Vector3::new(m, if w.touching[p] { m + contact * m } else { m }, m)
            };
            let (iterations, converged) =
                w.solver.solve(&w.elements, diagonal, &self.fixed, &w.rhs, &mut w.solution, params);
            report.iterations += iterations;
            report.converged = converged;
            // The floor only pushes: what would sink is added, what it would have to pull is let go.
            let mut changed = false;
            for p in 0..n {
                let below = params.floor && state.position[p].y + dt * w.solution[p].y < 0.0;
                changed |= below != w.touching[p];
                w.touching[p] = below;
            }
            if !changed {
                break;
            }
        }
        report.contacts = w.touching.iter().filter(|&&t| t).count();
        for p in 0..n {
            if !self.fixed[p] {
                state.velocity[p] = w.solution[p];
                state.position[p] += state.velocity[p] * dt;
            }
        }
        report
    }

    /// Forces at the old positions and the element matrices.
    fn linearise(
        &self,
        position: &[Vector3<f64>],
        dt: f64,
        params: &NetworkParams,
        w: &mut NetworkWorkspace,
        report: &mut NetworkReport,
    ) {
        w.force.clear();
        w.force.extend(self.mass.iter().map(|&m| params.gravity * m));
        w.elements.clear();
        let m = &self.material;
        for spring in &self.springs {
            let [a, b] = spring.ends;
            let stiffness = if spring.bends { m.bend_dyn } else { m.edge_dyn };
            let edge = position[b] - position[a];
            let length = edge.norm();
            if length <= f64::MIN_POSITIVE {
                continue;
            }
            let direction = edge / length;
            let tension = stiffness * (length / spring.rest_length - 1.0);
            w.force[a] += direction * tension;
            w.force[b] -= direction * tension;
            let around = if params.geometric_stiffness { dt * dt * tension.max(0.0) / length } else { 0.0 };
            let along = dt * (m.damping + dt * stiffness / spring.rest_length) - around;
            w.elements.push(Element::edge(spring.ends, direction, along, around));
        }
        if params.altitudes == AltitudeMode::Off {
            return;
        }
        for t in &self.tetrahedra {
            let x = t.corners.map(|c| position[c]);
            let Some(mut spring) = altitude(&x, &t.rest) else { continue };
            if params.altitudes == AltitudeMode::Unsigned && spring.length * spring.rest_length < 0.0 {
                spring.rest_length = -spring.rest_length;
            }
            report.altitudes += 1;
            let pull = m.altitude_dyn * spring.per_length * (spring.length - spring.rest_length);
            for (&corner, weight) in t.corners.iter().zip(spring.weight) {
                w.force[corner] -= spring.direction * (pull * weight);
            }
            let along = dt * (m.damping + dt * m.altitude_dyn * spring.per_length);
            w.elements.push(Element::altitude(t.corners, spring.weight, spring.direction, along));
        }
    }
}

impl NetworkMaterial {
    fn validate(&self) -> Result<(), Error> {
        let constants = [
            ("edge_dyn", self.edge_dyn),
            ("bend_dyn", self.bend_dyn),
            ("altitude_dyn", self.altitude_dyn),
            ("damping", self.damping),
        ];
        for (name, value) in constants {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::BadMaterial { name, value, expected: "finite and not negative" });
            }
        }
        if !(self.density.is_finite() && self.density > 0.0) {
            let expected = "finite and greater than zero";
            return Err(Error::BadMaterial { name: "density", value: self.density, expected });
        }
        Ok(())
    }
}

fn ordered(a: usize, b: usize) -> [usize; 2] {
    if a < b { [a, b] } else { [b, a] }
}

fn checked<const N: usize>(indices: &[u32; N], n_points: usize, element: usize) -> Result<[usize; N], Error> {
    let corners = indices.map(|i| i as usize);
    match corners.iter().find(|&&c| c >= n_points) {
        Some(&point) => Err(Error::UnknownPoint { element, point, n_points }),
        None => Ok(corners),
    }
}
