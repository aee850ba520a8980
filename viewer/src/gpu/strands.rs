//! Strands on their way to the device: what is uploaded of them, in which order and in how many pieces they are drawn.

use super::Renderer;
use super::draw::buffer;
use super::lights::Extents;
use crate::error::Error;
use crate::scene::{Curve, Scene, Strands};
use nalgebra::Vector3;
use wgpu::BufferUsages;

/// Lines drawn into each map of light; of more strands every second, third, ... stands for its neighbours.
const MAX_SHADOW_LINES: usize = 12_000;
/// Distance allowed between a curve and the pieces drawn for it, drawn pixels.
const SAG_PIXELS: f32 = 0.35;
/// Longest piece, drawn pixels: colours are interpolated along it.
const PIECE_PIXELS: f32 = 40.0;
/// Most pieces of a segment.
const MAX_PIECES: f32 = 8.0;

/// Where strands go that are not drawn: far off, all particles in one place, a ribbon without area.
const NOWHERE: [f32; 3] = [3e6; 3];

/// Strands on the device.
pub(super) struct Hair {
    pub positions: wgpu::Buffer,
    pub colours: wgpu::Buffer,
    pub order: wgpu::Buffer,
    pub n_particles: u32,
    pub n_strands: u32,
    pub pieces: u32,
    pub stride: u32,
    pub flags: u32,
    pub base: [f32; 3],
    pub width: f32,
    pub line_opacity: f32,
    pub curve: Curve,
}

/// Uploads strands and says how they are drawn.
pub(super) fn upload(renderer: &Renderer, scene: &Scene, strands: &Strands, extents: &Extents) -> Result<Hair, Error> {
    let (n, n_strands) = (strands.n_particles, strands.n_strands());
    let mut positions = strands.positions.to_vec();
    for strand in positions.chunks_exact_mut(n) {
        if !strand.iter().flatten().all(|x| x.is_finite()) {
            strand.fill(NOWHERE);
        }
    }
    let colours = strands.colour.colours(n_strands, n)?;
    let limit = renderer.device.limits().max_storage_buffer_binding_size;
    let needed = 12 * positions.len() as u64;
    if needed > limit {
        return Err(Error::TooLarge { what: "the strands' positions (bytes)", needed, limit });
    }
    let packed: Vec<u32> = colours.iter().map(packed).collect();
    let per_particle = colours.len() > 1;
    let flags = u32::from(per_particle) + 2 * u32::from(strands.colour.is_measure());
    let stride = n_strands.div_ceil(MAX_SHADOW_LINES).max(1) as u32;
    Ok(Hair {
        // A buffer holds something, even for no strands.
        positions: buffer(renderer, at_least(bytemuck::cast_slice(&positions)), BufferUsages::STORAGE),
        colours: buffer(renderer, at_least(bytemuck::cast_slice(&packed)), BufferUsages::STORAGE),
        order: buffer(renderer, at_least(bytemuck::cast_slice(&nearest_first(strands, scene))), BufferUsages::STORAGE),
        n_particles: n as u32,
        n_strands: n_strands as u32,
        pieces: pieces(scene, strands),
        stride,
        flags,
        base: colours.first().copied().unwrap_or_default(),
        width: strands.width_cm,
        line_opacity: extents.line_opacity(strands.width_cm, stride),
        curve: strands.curve,
    })
}

/// Strands by the distance of their middles from the eye: what hides others is drawn before them.
fn nearest_first(strands: &Strands, scene: &Scene) -> Vec<u32> {
    let eye = Vector3::from(scene.camera.eye);
    let n = strands.n_particles;
    let mut order: Vec<(f32, u32)> = (0..strands.n_strands())
        .map(|s| ((Vector3::from(strands.positions[s * n + n / 2]) - eye).norm_squared(), s as u32))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    order.into_iter().map(|(_, s)| s).collect()
}

fn at_least(bytes: &[u8]) -> &[u8] {
    if bytes.is_empty() { &[0; 16] } else { bytes }
}

/// Three times ten bits, as `packed` in `hair.wgsl`.
fn packed(colour: &[f32; 3]) -> u32 {
    let q = colour.map(|c| ((c.clamp(0.0, 4.0) * 0.25).sqrt() * 1023.0 + 0.5) as u32);
    q[0] | q[1] << 10 | q[2] << 20
}

/// Pieces of a segment of a curve, enough for nineteen segments in twenty: none long on the screen, none off the curve.
fn pieces(scene: &Scene, strands: &Strands) -> u32 {
    let eye = Vector3::from(scene.camera.eye);
    let pixel = scene.camera.pixel_at_one() / scene.supersampling as f32;
    // Some hundred strands tell for all.
    let step = (strands.n_strands() / 256).max(1);
    let mut needed = Vec::new();
    for strand in strands.positions.chunks_exact(strands.n_particles).step_by(step) {
        for three in strand.windows(3) {
            let [a, b, c] = [0, 1, 2].map(|k| Vector3::from(three[k]));
            let (into, out) = (b - a, c - b);
            let length = into.norm().max(out.norm()) / (pixel * (b - eye).norm()).max(1e-9);
            // A chord of an arc of `bend` radian is off it by an eighth of bend times length; both shrink with the pieces.
            let sag = (into.angle(&out) * length / (8.0 * SAG_PIXELS)).sqrt();
            needed.push(sag.max(length / PIECE_PIXELS));
        }
    }
    needed.retain(|x| x.is_finite());
    needed.sort_by(f32::total_cmp);
    let most = needed.get(needed.len() * 19 / 20).copied().unwrap_or(1.0);
    most.ceil().clamp(1.0, MAX_PIECES) as u32
}

impl Hair {
    pub fn n_points(&self) -> u32 {
        (self.n_particles - 1) * self.pieces + 1
    }

    /// `Hair` of `common.wgsl` for `count` strands from `first` on.
    pub fn uniform(&self, renderer: &Renderer, first: u32, count: u32) -> wgpu::Buffer {
        let curve = u32::from(self.curve == Curve::Through);
        let f = f32::to_bits;
        let words = [
            [self.n_particles, self.pieces, self.n_points(), count],
            [first, self.stride, curve, self.flags],
            [f(self.width), f(self.line_opacity), 0, 0],
            [f(self.base[0]), f(self.base[1]), f(self.base[2]), f(1.0)],
        ];
        buffer(renderer, bytemuck::cast_slice(&words), BufferUsages::UNIFORM)
    }
}
