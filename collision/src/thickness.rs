//! How thin a closed mesh gets: the scale at which contact must be sampled and the field be baked.
//!
//! Rays run inwards from triangle centres against the normal; half the length to the far wall estimates the local
//! half-thickness. A low percentile over triangles is taken rather than the least, since near a sharp edge the rays
//! graze and shrink to nothing.

use parry3d::math::Vector;
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;

/// Most triangles asked; larger meshes are asked at an even stride.
const MAX_RAYS: usize = 8192;
/// Share of rays that may be shorter than the answer.
const PERCENTILE: f32 = 0.02;
/// Start of a ray beneath its triangle, as a share of the box diagonal: enough to leave the wall it starts on.
const LIFT: f32 = 1e-5;

/// Smallest half-thickness of a closed, outward-facing mesh, cm. Falls back to a hundredth of the diagonal where no ray
/// meets a far wall.
pub(crate) fn smallest_half_thickness(mesh: &TriMesh) -> f32 {
    let aabb = mesh.local_aabb();
    let diagonal = (aabb.maxs - aabb.mins).length();
    let stride = mesh.num_triangles().div_ceil(MAX_RAYS).max(1);
    let lift = LIFT * diagonal;
    let mut halves: Vec<f32> = mesh
        .triangles()
        .step_by(stride)
        .filter_map(|t| {
            let normal: Vector = t.normal()?;
            let from = (t.a + t.b + t.c) / 3.0 - normal * lift;
            let length = mesh.cast_local_ray(&Ray::new(from, -normal), diagonal, false)?;
            Some(0.5 * (length + lift))
        })
        .filter(|&half| half > lift)
        .collect();
    if halves.is_empty() {
        return 0.01 * diagonal;
    }
    halves.sort_unstable_by(f32::total_cmp);
    halves[(halves.len() as f32 * PERCENTILE) as usize]
}
