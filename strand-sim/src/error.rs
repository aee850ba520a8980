//! What can be wrong with the strands and meshes a simulation is asked to step.

/// Why a strand system or a network could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Fewer particles per strand than the springs span.
    #[error("strands have {n_particles} particles, but the springs need at least {minimum}; resample the groom")]
    TooFewParticles {
        /// Particles per strand given.
        n_particles: usize,
        /// Least number accepted.
        minimum: usize,
    },
    /// The point buffer does not hold a whole number of strands.
    #[error("{n_points} points are not a whole number of strands of {n_particles} particles")]
    RaggedPoints {
        /// Points given.
        n_points: usize,
        /// Particles per strand.
        n_particles: usize,
    },
    /// A coordinate is not a number.
    #[error("strand {strand}, particle {particle} has a non-finite coordinate")]
    NonFinite {
        /// Strand index.
        strand: usize,
        /// Particle index.
        particle: usize,
    },
    /// A strand too short to carry springs.
    #[error("strand {strand} is {length_cm} cm long; drop strands shorter than {minimum_cm} cm before simulating")]
    TooShort {
        /// Strand index.
        strand: usize,
        /// Its arc length, cm.
        length_cm: f64,
        /// Shortest accepted, cm.
        minimum_cm: f64,
    },
    /// A material constant outside its range.
    #[error("material constant {name} is {value}; it must be {expected}")]
    BadMaterial {
        /// Field name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// A mesh names a point it does not have.
    #[error("element {element} names point {point}, but the mesh has only {n_points}")]
    UnknownPoint {
        /// Tetrahedron or triangle.
        element: usize,
        /// Index it names.
        point: usize,
        /// Points given.
        n_points: usize,
    },
    /// A mesh point's coordinate is not a number.
    #[error("mesh point {point} has a non-finite coordinate")]
    NonFinitePoint {
        /// Point index.
        point: usize,
    },
    /// A tetrahedron without volume has no altitude to keep.
    #[error(
        "tetrahedron {tetrahedron} has volume {volume_cm3} cm³ with edges up to {longest_cm} cm; remove or remesh slivers"
    )]
    FlatTetrahedron {
        /// Tetrahedron index.
        tetrahedron: usize,
        /// Its signed volume, cm³.
        volume_cm3: f64,
        /// Its longest edge, cm.
        longest_cm: f64,
    },
    /// A triangle without area.
    #[error("triangle {triangle} has area {area_cm2} cm²; remove or remesh slivers")]
    FlatTriangle {
        /// Triangle index.
        triangle: usize,
        /// Its area, cm².
        area_cm2: f64,
    },
    /// An edge that is not on a surface.
    #[error("edge {a}-{b} joins {n_triangles} triangles; a shell's edge has one or two different ones")]
    CrowdedEdge {
        /// One end.
        a: usize,
        /// The other.
        b: usize,
        /// Triangles around it.
        n_triangles: usize,
    },
    /// A point that belongs to no element has no mass.
    #[error("point {point} belongs to no element; remove it")]
    LoosePoint {
        /// Point index.
        point: usize,
    },
    /// Two joined points at one place.
    #[error("points {a} and {b} are joined but lie at one place; merge them")]
    CoincidentPoints {
        /// One point.
        a: usize,
        /// The other.
        b: usize,
    },
    /// A scalp that no root can be bound to.
    #[error("none of the scalp's {n_triangles} triangles has an area; give the scalp's surface mesh")]
    NoTriangles {
        /// Triangles given.
        n_triangles: usize,
    },
    /// Vertices that are not those of the scalp the roots were bound to.
    #[error("the deformed scalp has {n_vertices} vertices, but roots were bound to one of {expected}; keep the mesh")]
    OtherMesh {
        /// Vertices given.
        n_vertices: usize,
        /// Vertices of the rest mesh.
        expected: usize,
    },
    /// A root whose triangle has collapsed has no direction.
    #[error(
        "the triangle under the root of strand {strand} has collapsed to {area_cm2} cm²; repair the scalp's motion"
    )]
    LostTriangle {
        /// Strand index.
        strand: usize,
        /// Area left, cm².
        area_cm2: f64,
    },
    /// Spring constants that leave some motion without resistance.
    #[error(
        "the spring network of spacing {h_cm} cm has a motion that no spring resists; make every constant positive"
    )]
    SlackNetwork {
        /// Spacing, cm.
        h_cm: f64,
    },
    /// No positive spring constants have that bending and torsion stiffness.
    #[error(
        "no springs of spacing {h_cm} cm have EI = {ei} and GJ = {gj} dyn·cm²; change their ratio or stiffen the edges"
    )]
    OutOfReach {
        /// Bending stiffness asked, dyn·cm².
        ei: f64,
        /// Torsion stiffness asked, dyn·cm².
        gj: f64,
        /// Spacing, cm.
        h_cm: f64,
    },
    /// A constant of hair-hair interaction outside its range.
    #[error("interaction constant {name} is {value}; it must be {expected}")]
    BadInteraction {
        /// Field name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
}
