//! What can be wrong with a solid before it becomes a distance field.
//!
//! Queries never fail: everything is refused here, once, when a solid is built, with the defect counted and located so
//! that the artist knows what to repair.

use thiserror::Error;

/// Why a solid could not be turned into a [`crate::SignedDistanceField`].
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// There is nothing to bake.
    #[error(
        "solid has {n_vertices} vertices and {n_triangles} usable triangles; it needs at least 4 vertices and 3 triangles"
    )]
    EmptyMesh {
        /// Vertices given.
        n_vertices: usize,
        /// Triangles that are not collapsed to a line or a point.
        n_triangles: usize,
    },
    /// A vertex coordinate is infinite or not a number.
    #[error("vertex {vertex} is not finite: ({}, {}, {})", position[0], position[1], position[2])]
    NonFiniteVertex {
        /// Index into the vertex array given.
        vertex: usize,
        /// Its coordinates, cm.
        position: [f32; 3],
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but the mesh has only {n_vertices} vertices")]
    UnknownVertex {
        /// Index into the triangle array given.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Vertices given.
        n_vertices: usize,
    },
    /// The surface has holes so large that inside and outside are undefined.
    #[error(
        "mesh is open: {n_edges} boundary edges, the first between vertices {} and {}; closing its holes would take \
         {share_pct} % of its own area, so what is inside is anyone's guess; close the holes before baking",
        first[0], first[1]
    )]
    OpenMesh {
        /// Edges along which triangles are missing.
        n_edges: usize,
        /// Vertices of the first of them.
        first: [u32; 2],
        /// Area that would close the holes, percent of the mesh's own.
        share_pct: f32,
    },
    /// The surface has one side only, as a Möbius band or a Klein bottle.
    #[error(
        "mesh has one side only: its triangles cannot be wound consistently across {n_edges} edges, the first between \
         vertices {} and {}; cut the mesh there before baking",
        first[0], first[1]
    )]
    OneSided {
        /// Edges across which neighbours cannot be made to agree.
        n_edges: usize,
        /// Vertices of the first of them.
        first: [u32; 2],
    },
    /// The surface encloses nothing.
    #[error("mesh is flat: it encloses {volume_cm3} cm3 in a box of {box_cm3} cm3; give it thickness before baking")]
    NoVolume {
        /// Signed volume, cm^3.
        volume_cm3: f64,
        /// Volume of its bounding box, cm^3.
        box_cm3: f64,
    },
    /// A parameter of the bake makes no sense.
    #[error("{name} is {value}, but must be finite and greater than {above}")]
    BadParameter {
        /// Its name.
        name: &'static str,
        /// The value given.
        value: f32,
        /// The exclusive lower limit.
        above: f32,
    },
    /// The grid would not fit the memory granted.
    #[error(
        "a grid of {}x{}x{} nodes takes {bytes} bytes, more than the {max_bytes} granted; use a larger cell",
        nodes[0], nodes[1], nodes[2]
    )]
    TooLarge {
        /// Nodes along x, y and z.
        nodes: [usize; 3],
        /// Bytes the values would take.
        bytes: usize,
        /// Bytes granted.
        max_bytes: usize,
    },
    /// The distance function returned a value that is not finite.
    #[error("distance at ({}, {}, {}) is not finite", position[0], position[1], position[2])]
    NonFiniteDistance {
        /// Where, cm, in the solid's frame.
        position: [f32; 3],
    },
    /// The solid reaches out of the box it was to be baked in.
    #[error(
        "solid reaches the edge of its box: distance {distance} cm at ({}, {}, {}); enlarge the bounds",
        position[0], position[1], position[2]
    )]
    TouchesBounds {
        /// Distance found, cm.
        distance: f32,
        /// Where, cm, in the solid's frame.
        position: [f32; 3],
    },
    /// A deformation needs a start and an end.
    #[error("deforming solid has {n_keys} key frames, but needs at least 2")]
    TooFewKeys {
        /// Key frames given.
        n_keys: usize,
    },
    /// Key frames and their times are not one to one.
    #[error("deforming solid has {n_keys} key frames, but {n_times} times; give one time a key")]
    KeyTimes {
        /// Key frames given.
        n_keys: usize,
        /// Times given.
        n_times: usize,
    },
    /// Key frames out of order in time.
    #[error(
        "key frame {key} is at {time_s} s, not after the one before it at {before_s} s; sort the key frames by time"
    )]
    UnorderedKeys {
        /// The later of the two.
        key: usize,
        /// Its time, s.
        time_s: f64,
        /// Time of the one before, s.
        before_s: f64,
    },
    /// Key frames of different meshes.
    #[error("key frame {key} has {n_vertices} vertices, but the first has {expected}; key frames share one mesh")]
    RaggedKey {
        /// Key frame.
        key: usize,
        /// Its vertices.
        n_vertices: usize,
        /// Vertices of the first key frame.
        expected: usize,
    },
    /// One key frame cannot be baked.
    #[error("key frame {key} cannot be baked")]
    BadKey {
        /// Key frame.
        key: usize,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// The mesh library refused the triangles.
    #[error("mesh cannot be indexed for distance queries: {reason}")]
    Unusable {
        /// Its explanation.
        reason: String,
    },
    /// Bytes that are no field, or one of another layout.
    #[error("bytes hold no distance field: {reason}; bake the solid again")]
    BadBytes {
        /// What does not fit.
        reason: &'static str,
    },
}
