//! Projection, depth-tested lines and triangles, and the depth map seen from the light.
//!
//! Colours are linear until the picture is averaged down. Depth is the distance along the view axis; nearer wins, and
//! of equals the first drawn.

use nalgebra::{Matrix3, Vector3};

use super::Camera;
use hair_viewer::{Image, viewer_axes};

/// World to canvas.
pub(super) struct Projection {
    /// Right, up, backward as rows.
    pub axes: Matrix3<f32>,
    eye: Vector3<f32>,
    focal: f32,
    middle: [f32; 2],
}

/// Nothing nearer to the eye than this is drawn, cm.
const NEAREST: f32 = 0.5;

impl Projection {
    /// The camera's view at `scale` samples per pixel.
    pub fn perspective(camera: &Camera, scale: usize) -> Self {
        let (w, h) = ((camera.width * scale) as f32, (camera.height * scale) as f32);
        Self {
            axes: viewer_axes(Vector3::from(camera.target) - Vector3::from(camera.eye)),
            eye: Vector3::from(camera.eye),
            focal: 0.5 * h / (0.5 * camera.vertical_fov).tan(),
            middle: [0.5 * w, 0.5 * h],
        }
    }

    /// Column, row (pixels of the canvas) and depth (cm); `None` too near or behind.
    fn project(&self, p: &Vector3<f32>) -> Option<Vector3<f32>> {
        let q = self.axes * (p - self.eye);
        let depth = -q.z;
        (depth > NEAREST).then(|| {
            let k = self.focal / depth;
            Vector3::new(self.middle[0] + k * q.x, self.middle[1] - k * q.y, depth)
        })
    }
}

/// A point with its colour.
pub(super) type Shaded = (Vector3<f32>, Vector3<f32>);

/// Colours and depths of the picture in the making.
pub(super) struct Canvas {
    width: usize,
    height: usize,
    color: Vec<Vector3<f32>>,
    depth: Vec<f32>,
}

impl Canvas {
    /// A backdrop from a colour at the top to one at the bottom.
    pub fn new(width: usize, height: usize, backdrop: [[f32; 3]; 2]) -> Self {
        let [top, bottom] = backdrop.map(Vector3::from);
        let color = (0..width * height).map(|n| top.lerp(&bottom, (n / width) as f32 / height as f32)).collect();
        Self { width, height, color, depth: vec![f32::INFINITY; width * height] }
    }

    fn put(&mut self, x: usize, y: usize, depth: f32, color: &Vector3<f32>) {
        let n = y * self.width + x;
        if depth < self.depth[n] {
            self.depth[n] = depth;
            self.color[n] = *color;
        }
    }

    /// A line of the given width (cm), at least one sample wide.
    pub fn line(&mut self, view: &Projection, a: &Shaded, b: &Shaded, width_cm: f32) {
        let (Some(p), Some(q)) = (view.project(&a.0), view.project(&b.0)) else { return };
        let (dx, dy) = (q.x - p.x, q.y - p.y);
        let steep = dy.abs() > dx.abs();
        // Walk along the longer axis, a sample at a time, filling across.
        let steps = dx.abs().max(dy.abs()).ceil().max(1.0);
        let limit = 4.0 * (self.width + self.height) as f32;
        if !(p.x.abs() < limit && p.y.abs() < limit && q.x.abs() < limit && q.y.abs() < limit) {
            return;
        }
        let wide = (width_cm * view.focal / (0.5 * (p.z + q.z))).max(1.0);
        for n in 0..steps as usize {
            let t = n as f32 / steps;
            let at = p.lerp(&q, t);
            let color = a.1.lerp(&b.1, t);
            let (along, across) = if steep { (at.y, at.x) } else { (at.x, at.y) };
            let (along_end, across_end) = if steep { (self.height, self.width) } else { (self.width, self.height) };
            if along < 0.0 || along >= along_end as f32 {
                continue;
            }
            let from = (across - 0.5 * wide + 0.5).floor().max(0.0) as usize;
            let to = ((across + 0.5 * wide + 0.5).floor().max(0.0) as usize).min(across_end);
            for c in from..to {
                let (x, y) = if steep { (c, along as usize) } else { (along as usize, c) };
                self.put(x, y, at.z, &color);
            }
        }
    }

    /// A triangle seen from its front.
    pub fn triangle(&mut self, view: &Projection, corners: &[Shaded; 3]) {
        let [Some(a), Some(b), Some(c)] = corners.map(|(p, _)| view.project(&p)) else { return };
        // Rows grow downwards, so that what is counter-clockwise in the world has negative area here.
        let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
        if area >= 0.0 {
            return;
        }
        let span = |low: f32, high: f32, end: usize| {
            (low.floor().clamp(0.0, end as f32) as usize)..(high.ceil().clamp(0.0, end as f32) as usize)
        };
        for y in span(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y), self.height) {
            for x in span(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x), self.width) {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let weight =
                    |u: &Vector3<f32>, v: &Vector3<f32>| ((v.x - u.x) * (py - u.y) - (px - u.x) * (v.y - u.y)) / area;
                let w = Vector3::new(weight(&b, &c), weight(&c, &a), weight(&a, &b));
                if w.min() >= 0.0 {
                    let color = corners[0].1 * w.x + corners[1].1 * w.y + corners[2].1 * w.z;
                    self.put(x, y, a.z * w.x + b.z * w.y + c.z * w.z, &color);
                }
            }
        }
    }

    /// The picture: means over `scale` by `scale` samples, for display (sRGB, by a power of 2.2).
    pub fn average(&self, scale: usize) -> Image {
        let (width, height) = (self.width / scale, self.height / scale);
        let mut image = Image { width, height, rgb: Vec::with_capacity(3 * width * height) };
        for y in 0..height {
            for x in 0..width {
                let mut sum = Vector3::zeros();
                for n in 0..scale * scale {
                    sum += self.color[(y * scale + n / scale) * self.width + x * scale + n % scale];
                }
                let mean = sum / (scale * scale) as f32;
                image.rgb.extend(mean.iter().map(|c| (c.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0 + 0.5) as u8));
            }
        }
        image
    }
}

/// Depth maps seen from the light: where hair begins, and where a solid does.
pub(super) struct Shadow {
    axes: Matrix3<f32>,
    origin: [f32; 2],
    texels_per_cm: f32,
    hair: Vec<f32>,
    solid: Vec<f32>,
}

/// Texels along each side of the map.
const MAP: usize = 384;
/// Depth of hair in which light falls to 1/e, cm.
const HAIR_DEPTH: f32 = 0.9;

impl Shadow {
    /// A map that holds all points, seen along `-toward_light`.
    pub fn around(toward_light: Vector3<f32>, points: impl Iterator<Item = Vector3<f32>>) -> Self {
        let axes = viewer_axes(-toward_light);
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for p in points {
            let q = axes * p;
            for k in 0..2 {
                low[k] = low[k].min(q[k]);
                high[k] = high[k].max(q[k]);
            }
        }
        let size = (high[0] - low[0]).max(high[1] - low[1]).max(1e-3);
        let size = if size.is_finite() { size } else { 1.0 };
        Self {
            axes,
            origin: low,
            texels_per_cm: (MAP - 1) as f32 / size,
            hair: vec![f32::INFINITY; MAP * MAP],
            solid: vec![f32::INFINITY; MAP * MAP],
        }
    }

    /// Column and row (texels) and depth away from the light (cm).
    fn place(&self, p: &Vector3<f32>) -> (f32, f32, f32) {
        let q = self.axes * p;
        let texel = |k: usize| ((q[k] - self.origin[k]) * self.texels_per_cm).clamp(0.0, (MAP - 1) as f32);
        (texel(0), texel(1), -q.z)
    }

    pub fn add_hair(&mut self, p: &Vector3<f32>) {
        let (x, y, depth) = self.place(p);
        let texel = &mut self.hair[y as usize * MAP + x as usize];
        *texel = texel.min(depth);
    }

    pub fn add_triangle(&mut self, corners: [Vector3<f32>; 3]) {
        let [a, b, c] = corners.map(|p| self.place(&p));
        // Points strewn at texel distance: a map of this size needs no exact coverage.
        let longest = [(a, b), (b, c), (c, a)].map(|(u, v)| (u.0 - v.0).abs().max((u.1 - v.1).abs()));
        let n = (longest.into_iter().fold(0.0, f32::max) * 1.5).ceil().clamp(1.0, 2.0 * MAP as f32) as usize;
        for i in 0..=n {
            for j in 0..=n - i {
                let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                let mix = |a: f32, b: f32, c: f32| a + u * (b - a) + v * (c - a);
                let (x, y) = (mix(a.0, b.0, c.0), mix(a.1, b.1, c.1));
                let texel = &mut self.solid[y as usize * MAP + x as usize];
                *texel = texel.min(mix(a.2, b.2, c.2));
            }
        }
    }

    /// Averages the hair map over neighbours, so that single strands do not cast hard stripes.
    pub fn soften(&mut self) {
        const REACH: isize = 2;
        let source = self.hair.clone();
        for y in 0..MAP as isize {
            for x in 0..MAP as isize {
                let (mut sum, mut n) = (0.0, 0);
                for dy in -REACH..=REACH {
                    for dx in -REACH..=REACH {
                        let (u, v) = ((x + dx).clamp(0, MAP as isize - 1), (y + dy).clamp(0, MAP as isize - 1));
                        let depth = source[v as usize * MAP + u as usize];
                        if depth.is_finite() {
                            sum += depth;
                            n += 1;
                        }
                    }
                }
                self.hair[y as usize * MAP + x as usize] = if n > 0 { sum / n as f32 } else { f32::INFINITY };
            }
        }
    }

    /// Share of the light that reaches a point of the hair.
    pub fn light_in_hair(&self, p: &Vector3<f32>) -> f32 {
        let (x, y, depth) = self.place(p);
        let n = y as usize * MAP + x as usize;
        let behind_hair = (depth - self.hair[n]).max(0.0);
        let lit = 0.12 + 0.88 * (-behind_hair / HAIR_DEPTH).exp();
        if depth > self.solid[n] + 0.6 { 0.35 * lit } else { lit }
    }

    /// Share of the light that reaches a point of a solid.
    pub fn light_on_solid(&self, p: &Vector3<f32>) -> f32 {
        let (x, y, depth) = self.place(p);
        let n = y as usize * MAP + x as usize;
        let behind_hair = (depth - self.hair[n]).max(0.0);
        let lit = 0.3 + 0.7 * (-behind_hair / HAIR_DEPTH).exp();
        if depth > self.solid[n] + 0.8 { 0.3 * lit } else { lit }
    }
}
