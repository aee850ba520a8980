//! Pictures without a window: hair as lit lines, solids as lit triangles, in a depth buffer on the CPU.
//!
//! Hair is shaded after Kajiya and Kay (light across the strand is diffuse, about the mirror cone specular); a depth
//! map from the light darkens what lies behind other hair or a solid, softly, which is what makes hair read as a volume.
//! Everything is drawn at a multiple of the picture's size and averaged down. The same inputs give the same picture.

use nalgebra::Vector3;

mod raster;

pub use hair_viewer::{Camera, Image, contact_sheet};

use raster::{Canvas, Projection, Shadow};

/// Strands of one look.
#[derive(Debug, Clone, Copy)]
pub struct HairView<'a> {
    /// Positions in the world (cm), strand-major, root first.
    pub points: &'a [[f32; 3]],
    /// Particles of each strand.
    pub n_particles: usize,
    /// Linear red, green, blue in 0..1.
    pub color: [f32; 3],
    /// Drawn width, cm; wider than hair where few strands stand for many.
    pub width_cm: f32,
}

/// A solid to draw.
#[derive(Debug, Clone, Copy)]
pub struct SolidView<'a> {
    /// Positions in the world, cm.
    pub vertices: &'a [[f32; 3]],
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Linear red, green, blue in 0..1.
    pub color: [f32; 3],
}

/// All that a picture shows.
#[derive(Debug, Clone)]
pub struct Picture<'a> {
    /// From where.
    pub camera: Camera,
    /// Hair.
    pub hair: Vec<HairView<'a>>,
    /// Solids.
    pub solids: Vec<SolidView<'a>>,
    /// Samples per pixel along each axis; 2 or 3 look smooth.
    pub supersampling: usize,
}

impl<'a> Picture<'a> {
    /// An empty picture with two samples per pixel along each axis.
    pub fn new(camera: Camera) -> Self {
        Self { camera, hair: Vec::new(), solids: Vec::new(), supersampling: 2 }
    }

    /// With hair of brown, drawn at a width (cm) that lets this many strands cover a head.
    #[must_use]
    pub fn with_hair(mut self, points: &'a [[f32; 3]], n_particles: usize) -> Self {
        let n_strands = (points.len() / n_particles.max(1)).max(1) as f32;
        let width_cm = (4.0 / n_strands.sqrt()).clamp(0.012, 0.25);
        self.hair.push(HairView { points, n_particles, color: [0.26, 0.135, 0.06], width_cm });
        self
    }

    /// With a solid.
    #[must_use]
    pub fn with_solid(mut self, mesh: &'a io_formats::mesh::TriMesh, color: [f32; 3]) -> Self {
        self.solids.push(SolidView { vertices: &mesh.vertices, triangles: &mesh.triangles, color });
        self
    }
}

/// Skin, for heads.
pub const SKIN: [f32; 3] = [0.66, 0.43, 0.33];
/// Horn, for combs and rods.
pub const HORN: [f32; 3] = [0.75, 0.62, 0.28];

/// Curve pieces drawn per strand segment.
const PIECES: usize = 4;

/// Draws a picture. Points that are not finite are left out.
pub fn render(picture: &Picture) -> Image {
    let camera = &picture.camera;
    let scale = picture.supersampling.clamp(1, 4);
    let eye = Vector3::from(camera.eye);
    let view = Projection::perspective(camera, scale);
    // Over the viewer's left shoulder: shapes read best in light from above and aside.
    let toward_light = (view.axes.transpose() * Vector3::new(-0.55, 0.75, 0.8)).normalize();

    let curves: Vec<Vec<Curve>> = picture.hair.iter().map(curves_of).collect();
    let mut shadow = Shadow::around(toward_light, all_points(picture));
    for curve in curves.iter().flatten() {
        curve.points.iter().for_each(|p| shadow.add_hair(p));
    }
    for solid in &picture.solids {
        for t in solid.triangles {
            shadow.add_triangle(t.map(|v| vertex(solid, v)));
        }
    }
    shadow.soften();

    let mut canvas = Canvas::new(camera.width * scale, camera.height * scale);
    for solid in &picture.solids {
        let normals = vertex_normals(solid);
        for t in solid.triangles {
            let corner = t.map(|v| {
                let p = vertex(solid, v);
                let n = normals[v as usize];
                (p, solid_color(solid.color, &p, &n, &eye, &toward_light, shadow.light_on_solid(&(p + n * 0.15))))
            });
            canvas.triangle(&view, &corner);
        }
    }
    for (hair, curves) in picture.hair.iter().zip(&curves) {
        for (n, curve) in curves.iter().enumerate() {
            let tint = strand_tint(n);
            let color = Vector3::from(hair.color).map(|c| c * tint);
            let shaded: Vec<_> = (0..curve.points.len())
                .map(|i| (curve.points[i], curve.shade(i, &color, &eye, &toward_light, &shadow)))
                .collect();
            for pair in shaded.windows(2) {
                canvas.line(&view, &pair[0], &pair[1], hair.width_cm);
            }
        }
    }
    canvas.average(scale)
}

/// A strand as a fine polyline.
struct Curve {
    points: Vec<Vector3<f32>>,
}

impl Curve {
    /// Colour of point `i`.
    fn shade(
        &self,
        i: usize,
        color: &Vector3<f32>,
        eye: &Vector3<f32>,
        toward_light: &Vector3<f32>,
        shadow: &Shadow,
    ) -> Vector3<f32> {
        const SHINE: f32 = 60.0;
        const GLOW: f32 = 14.0;
        let last = self.points.len() - 1;
        let p = self.points[i];
        let tangent = unit(self.points[(i + 1).min(last)] - self.points[i.saturating_sub(1)]);
        let toward_eye = unit(eye - p);
        let (tl, tv) = (tangent.dot(toward_light), tangent.dot(&toward_eye));
        let (sin_l, sin_v) = ((1.0 - tl * tl).max(0.0).sqrt(), (1.0 - tv * tv).max(0.0).sqrt());
        // Two cones, the coloured one tilted towards the root by the scales of the cuticle.
        let mirror = (sin_l * sin_v - tl * tv).max(0.0);
        let tilted = (mirror - 0.04 * tv).clamp(0.0, 1.0);
        let light = shadow.light_in_hair(&p);
        // Light from everywhere reaches the outer lengths, hardly the roots.
        let open = 0.45 + 0.55 * (i as f32 / last.max(1) as f32 * 3.0).min(1.0);
        let diffuse = color * (0.28 * open + 1.15 * sin_l * light);
        let glow = color * (1.1 * tilted.powf(GLOW) * light);
        diffuse + glow + Vector3::repeat(0.16 * mirror.powf(SHINE) * light * light)
    }
}

/// Catmull-Rom curves through the particles of each strand.
fn curves_of(hair: &HairView) -> Vec<Curve> {
    hair.points
        .chunks_exact(hair.n_particles.max(2))
        .map(|strand| {
            let at = |i: usize| Vector3::from(strand[i.min(strand.len() - 1)]);
            let mut points = Vec::with_capacity((strand.len() - 1) * PIECES + 1);
            for i in 0..strand.len() - 1 {
                let (p, q) = (at(i), at(i + 1));
                let (dp, dq) = ((q - at(i.saturating_sub(1))) * 0.5, (at(i + 2) - p) * 0.5);
                for k in 0..PIECES {
                    let t = k as f32 / PIECES as f32;
                    let (t2, t3) = (t * t, t * t * t);
                    points.push(
                        p * (2.0 * t3 - 3.0 * t2 + 1.0)
                            + dp * (t3 - 2.0 * t2 + t)
                            + q * (3.0 * t2 - 2.0 * t3)
                            + dq * (t3 - t2),
                    );
                }
            }
            points.push(at(strand.len() - 1));
            Curve { points }
        })
        .filter(|curve| curve.points.iter().all(|p| p.iter().all(|x| x.is_finite())))
        .collect()
}

/// Brightness of a strand against its neighbours, so that single strands can be told apart.
fn strand_tint(n: usize) -> f32 {
    let h = (n as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    0.72 + 0.56 * (h as f32 / (1u64 << 24) as f32)
}

fn solid_color(
    color: [f32; 3],
    p: &Vector3<f32>,
    normal: &Vector3<f32>,
    eye: &Vector3<f32>,
    toward_light: &Vector3<f32>,
    light: f32,
) -> Vector3<f32> {
    let half = unit(toward_light + unit(eye - p));
    let lit = normal.dot(toward_light).max(0.0) * light;
    let sky = 0.5 + 0.5 * normal.y;
    Vector3::from(color) * (0.18 + 0.14 * sky + 0.75 * lit)
        + Vector3::repeat(0.10 * light * normal.dot(&half).max(0.0).powi(30))
}

fn vertex(solid: &SolidView, v: u32) -> Vector3<f32> {
    // An index past the end draws at the origin rather than failing: pictures are for looking at what is there.
    solid.vertices.get(v as usize).copied().unwrap_or_default().into()
}

fn vertex_normals(solid: &SolidView) -> Vec<Vector3<f32>> {
    let n = solid.triangles.iter().flatten().map(|&v| v as usize + 1).max().unwrap_or(0).max(solid.vertices.len());
    let mut normals = vec![Vector3::zeros(); n];
    for t in solid.triangles {
        let [a, b, c] = t.map(|v| vertex(solid, v));
        let area = (b - a).cross(&(c - a));
        t.iter().for_each(|&v| normals[v as usize] += area);
    }
    normals.into_iter().map(unit).collect()
}

fn all_points<'a>(picture: &'a Picture) -> impl Iterator<Item = Vector3<f32>> + 'a {
    let hair = picture.hair.iter().flat_map(|h| h.points);
    let solids = picture.solids.iter().flat_map(|s| s.vertices);
    hair.chain(solids).map(|p| Vector3::from(*p)).filter(|p| p.iter().all(|x| x.is_finite()))
}

/// `v` at unit length, or zero where it has no direction.
fn unit(v: Vector3<f32>) -> Vector3<f32> {
    v.try_normalize(1e-12).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { eye: [0.0, 0.0, 20.0], target: [0.0; 3], vertical_fov: 0.5, width: 64, height: 48 }
    }

    fn brightness(image: &Image, x: usize, y: usize) -> u32 {
        image.rgb[3 * (y * image.width + x)..][..3].iter().map(|&c| u32::from(c)).sum()
    }

    #[test]
    fn a_strand_is_drawn_where_the_camera_sees_it_and_hidden_behind_a_solid() {
        let strand: Vec<[f32; 3]> = (0..5).map(|n| [0.0, n as f32 - 2.0, -3.0]).collect();
        let square = [[-2.0, -3.0, 0.0], [2.0, -3.0, 0.0], [2.0, 3.0, 0.0], [-2.0, 3.0, 0.0]];
        let mesh = io_formats::mesh::TriMesh { vertices: square.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]] };
        let empty = render(&Picture::new(camera()));
        let hair = render(&Picture::new(camera()).with_hair(&strand, 5));
        assert_ne!(brightness(&hair, 32, 24), brightness(&empty, 32, 24));
        assert_eq!(brightness(&hair, 8, 24), brightness(&empty, 8, 24));
        let behind = render(&Picture::new(camera()).with_hair(&strand, 5).with_solid(&mesh, SKIN));
        let alone = render(&Picture::new(camera()).with_solid(&mesh, SKIN));
        // Whatever shadow the hair casts falls away from the viewer here.
        assert_eq!(behind.rgb, alone.rgb);
    }

    #[test]
    fn points_that_are_not_finite_or_behind_the_camera_are_left_out() {
        let strand = [[f32::NAN; 3], [0.0, 1.0, 0.0]];
        let behind = [[0.0, 0.0, 30.0], [0.0, 1.0, 40.0]];
        let empty = render(&Picture::new(camera()));
        assert_eq!(render(&Picture::new(camera()).with_hair(&strand, 2)), empty);
        assert_eq!(render(&Picture::new(camera()).with_hair(&behind, 2)), empty);
    }
}
