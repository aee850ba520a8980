//! Lights and the frame as the shaders see them: where each light's map lies, what the camera projects, in one uniform.

use crate::camera::viewer_axes;
use crate::scene::{Scene, Shading};
use nalgebra::{Matrix4, Vector3, Vector4};

/// Texels along each side of a map of light, as in `common.wgsl`.
pub(super) const MAP_SIZE: u32 = 1024;
/// Lights there are.
pub(super) const N_LIGHTS: u32 = 3;

/// Direction to each light as the viewer sees it (right, up, backward) and its colour: a warm one over the left shoulder,
/// a weak cool one from the right, one from behind and above that outlines the hair.
const LIGHTS: [([f32; 3], [f32; 3]); N_LIGHTS as usize] = [
    ([-0.55, 0.75, 0.80], [3.0, 2.85, 2.6]),
    ([0.9, 0.15, 0.55], [0.55, 0.62, 0.75]),
    ([0.35, 0.75, -0.8], [1.2, 1.2, 1.3]),
];

/// Far ends of the layers of opacity behind the first hair, cm: thin where light still comes through.
const LAYERS: [f32; 4] = [0.2, 0.7, 2.0, 6.0];

/// Extent of all that is drawn along the axes of each light and of the camera.
pub(super) struct Extents {
    axes: Vec<nalgebra::Matrix3<f32>>,
    low: Vec<Vector3<f32>>,
    high: Vec<Vector3<f32>>,
}

impl Extents {
    pub fn of(scene: &Scene, solid_points: impl Iterator<Item = Vector3<f32>>) -> Self {
        let view = scene.camera.axes();
        let mut axes: Vec<_> =
            LIGHTS.iter().map(|(toward, _)| viewer_axes(-(view.transpose() * Vector3::from(*toward)))).collect();
        axes.push(view);
        let n = axes.len();
        let mut out =
            Self { axes, low: vec![Vector3::repeat(f32::INFINITY); n], high: vec![Vector3::repeat(-f32::INFINITY); n] };
        let hair = scene.strands.iter().flat_map(|s| s.positions).map(|p| Vector3::from(*p));
        for p in hair.chain(solid_points).filter(|p| p.iter().all(|x| x.is_finite())) {
            for k in 0..n {
                let q = out.axes[k] * p;
                out.low[k] = out.low[k].inf(&q);
                out.high[k] = out.high[k].sup(&q);
            }
        }
        // An empty scene has some extent too.
        for k in 0..n {
            if out.low[k].x > out.high[k].x {
                (out.low[k], out.high[k]) = (Vector3::repeat(-1.0), Vector3::repeat(1.0));
            }
        }
        out
    }

    /// Texels of a light's map to a centimetre.
    fn texels_per_cm(&self, k: usize) -> f32 {
        let size = self.high[k] - self.low[k];
        (MAP_SIZE - 8) as f32 / size.x.max(size.y).max(0.1)
    }

    /// Optical depth that a line of hair of this width adds to a texel of the coarsest map, each standing for `stride`.
    pub fn line_opacity(&self, width_cm: f32, stride: u32) -> f32 {
        // Fibres let most of what they take through or around; this is what keeps a head of hair from turning black.
        const TAKEN: f32 = 0.45;
        let texels = (0..N_LIGHTS as usize).map(|k| self.texels_per_cm(k)).fold(f32::INFINITY, f32::min);
        TAKEN * width_cm * texels * stride as f32
    }

    /// Depth range of the picture along the view (cm from the eye).
    fn depth_range(&self, eye: &Vector3<f32>) -> [f32; 2] {
        let k = N_LIGHTS as usize;
        let at = (self.axes[k] * eye).z;
        let (near, far) = (at - self.high[k].z, at - self.low[k].z);
        // Nothing nearer than a thousandth of the farthest is drawn: depths would lose their digits.
        let far = far.max(1.0) * 1.01 + 0.1;
        [(near * 0.99 - 0.1).max(far * 1e-3), far]
    }

    /// The frame, as `Frame` in `common.wgsl`.
    pub fn frame(&self, scene: &Scene) -> Vec<f32> {
        let camera = &scene.camera;
        let eye = Vector3::from(camera.eye);
        let scale = scene.supersampling as f32;
        let mut out: Vec<f32> = self.clip_from_world(scene).as_slice().to_vec();
        out.extend([eye.x, eye.y, eye.z, camera.pixel_at_one() / scale]);
        scene.backdrop.iter().for_each(|c| out.extend([c[0], c[1], c[2], 1.0]));
        out.extend(LAYERS);
        let flat = f32::from(u8::from(scene.shading == Shading::Flat));
        out.extend([flat, scale, camera.width as f32, camera.height as f32]);
        for k in 0..N_LIGHTS as usize {
            let (axes, low, high) = (&self.axes[k], self.low[k], self.high[k]);
            let texels = self.texels_per_cm(k);
            let middle = 0.5 * (low + high);
            let half = 0.5 * MAP_SIZE as f32;
            let mut map = Matrix4::zeros();
            // Rows of the map grow downwards; depth grows away from the light, 1 cm being left before and behind.
            let row = |axis: Vector3<f32>, scale: f32, at: f32| {
                let a = axis * scale;
                Vector4::new(a.x, a.y, a.z, at).transpose()
            };
            map.set_row(0, &row(axes.row(0).transpose(), texels, half - texels * middle.x));
            map.set_row(1, &row(axes.row(1).transpose(), -texels, half + texels * middle.y));
            map.set_row(2, &row(axes.row(2).transpose(), -1.0, high.z + 1.0));
            map[(3, 3)] = 1.0;
            out.extend(map.as_slice());
            // A light's viewer looks away from it: backward is toward it.
            let toward = axes.row(2);
            out.extend([toward[0], toward[1], toward[2], high.z - low.z + 2.0]);
            let colour = LIGHTS[k].1;
            out.extend([colour[0], colour[1], colour[2], 1.0]);
        }
        out
    }

    fn clip_from_world(&self, scene: &Scene) -> Matrix4<f32> {
        let camera = &scene.camera;
        let eye = Vector3::from(camera.eye);
        let axes = camera.axes();
        let mut view = Matrix4::identity();
        view.fixed_view_mut::<3, 3>(0, 0).copy_from(&axes);
        view.fixed_view_mut::<3, 1>(0, 3).copy_from(&(-(axes * eye)));
        let [near, far] = self.depth_range(&eye);
        let focal = 1.0 / (0.5 * camera.vertical_fov).tan();
        let aspect = camera.width as f32 / camera.height as f32;
        let mut clip = Matrix4::zeros();
        clip[(0, 0)] = focal / aspect;
        clip[(1, 1)] = focal;
        // Depth 0 at the near plane, 1 at the far one; the viewer looks along -z.
        clip[(2, 2)] = far / (near - far);
        clip[(2, 3)] = near * far / (near - far);
        clip[(3, 2)] = -1.0;
        clip * view
    }
}
