//! Pictures without a window: hair as lit lines, solids as lit triangles, in a depth buffer on the CPU.
//!
//! Hair is shaded after Kajiya and Kay (light across the strand is diffuse, about the mirror cone specular); a depth
//! map from the light darkens what lies behind other hair or a solid, softly, which is what makes hair read as a volume.
//! Everything is drawn at a multiple of the picture's size and averaged down. The same inputs give the same picture.

use nalgebra::Vector3;

mod raster;

pub use hair_viewer::{Camera, Image, contact_sheet};

use hair_viewer::{ColourBy, Error, Scene, SolidMesh, Strands};
use raster::{Canvas, Projection, Shadow};

/// Curve pieces drawn per strand segment.
const PIECES: usize = 4;
/// Lines of one depth cover less than the renderer's ribbons: they are wider by so much.
const WIDER: f32 = 1.3;
/// Brightness of hair over that in the renderer, which adds light scattered among hairs.
const BRIGHTER: f32 = 2.3;

/// Draws what the renderer of `hair-viewer` would, by the processor alone: every curve goes through its particles. Strands with a
/// point that is not finite are left out.
///
/// # Errors
/// A scene that cannot be drawn ([`Scene::check`]).
pub fn render(picture: &Scene) -> Result<Image, Error> {
    picture.check()?;
    let camera = &picture.camera;
    let scale = picture.supersampling;
    let eye = Vector3::from(camera.eye);
    let view = Projection::perspective(camera, scale);
    // Over the viewer's left shoulder: shapes read best in light from above and aside.
    let toward_light = (view.axes.transpose() * Vector3::new(-0.55, 0.75, 0.8)).normalize();

    let curves = picture.strands.iter().map(curves_of).collect::<Result<Vec<_>, _>>()?;
    let solids: Vec<_> = picture.solids.iter().map(|solid| (solid, solid.placed())).collect();
    let of_solids = solids.iter().flat_map(|(_, placed)| placed.iter().map(|v| v[0]));
    let of_hair = picture.strands.iter().flat_map(|s| s.positions).map(|p| Vector3::from(*p));
    let all = of_hair.chain(of_solids).filter(|p| p.iter().all(|x| x.is_finite()));
    let mut shadow = Shadow::around(toward_light, all);
    for curve in curves.iter().flatten() {
        curve.points.iter().for_each(|p| shadow.add_hair(p));
    }
    for (solid, placed) in &solids {
        for t in solid.triangles {
            shadow.add_triangle(t.map(|v| placed[v as usize][0]));
        }
    }
    shadow.soften();

    let mut canvas = Canvas::new(camera.width * scale, camera.height * scale, picture.backdrop);
    for (solid, placed) in &solids {
        for t in solid.triangles {
            let corner = t.map(|v| {
                let [p, n] = placed[v as usize];
                (p, solid_color(solid, &p, &n, &eye, &toward_light, shadow.light_on_solid(&(p + n * 0.15))))
            });
            canvas.triangle(&view, &corner);
        }
    }
    for (strands, curves) in picture.strands.iter().zip(&curves) {
        let by_light = !strands.colour.is_measure();
        for curve in curves {
            let color = |i: usize| {
                let color = Vector3::from(curve.colors[i.div_ceil(PIECES).min(curve.colors.len() - 1)]);
                if by_light { curve.shade(i, &(color * curve.tint), &eye, &toward_light, &shadow) } else { color }
            };
            let shaded: Vec<_> = (0..curve.points.len()).map(|i| (curve.points[i], color(i))).collect();
            for pair in shaded.windows(2) {
                canvas.line(&view, &pair[0], &pair[1], WIDER * strands.width_cm);
            }
        }
    }
    Ok(canvas.average(scale))
}

/// A strand as a fine polyline.
struct Curve {
    points: Vec<Vector3<f32>>,
    /// One for each particle, or one for all.
    colors: Vec<[f32; 3]>,
    /// Brightness against its neighbours.
    tint: f32,
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
fn curves_of(strands: &Strands) -> Result<Vec<Curve>, Error> {
    let n = strands.n_particles;
    let brighter = if matches!(strands.colour, ColourBy::Hair(_)) { BRIGHTER } else { 1.0 };
    let colors = strands.colour.colours(strands.n_strands(), n)?;
    let curves = strands
        .positions
        .chunks_exact(n)
        .enumerate()
        .map(|(k, strand)| {
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
            let colors = if colors.len() > 1 { colors[k * n..(k + 1) * n].to_vec() } else { colors.clone() };
            Curve { points, colors, tint: brighter * strand_tint(k) }
        })
        .filter(|curve| curve.points.iter().all(|p| p.iter().all(|x| x.is_finite())));
    Ok(curves.collect())
}

/// Brightness of a strand against its neighbours, so that single strands can be told apart.
fn strand_tint(n: usize) -> f32 {
    let h = (n as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
    0.72 + 0.56 * (h as f32 / (1u64 << 24) as f32)
}

fn solid_color(
    solid: &SolidMesh,
    p: &Vector3<f32>,
    normal: &Vector3<f32>,
    eye: &Vector3<f32>,
    toward_light: &Vector3<f32>,
    light: f32,
) -> Vector3<f32> {
    let half = unit(toward_light + unit(eye - p));
    let lit = normal.dot(toward_light).max(0.0) * light;
    let sky = 0.5 + 0.5 * normal.y;
    Vector3::from(solid.colour) * (0.18 + 0.14 * sky + 0.75 * lit)
        + Vector3::repeat(0.10 * light * normal.dot(&half).max(0.0).powi(30))
}

/// `v` at unit length, or zero where it has no direction.
fn unit(v: Vector3<f32>) -> Vector3<f32> {
    v.try_normalize(1e-12).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hair_viewer::{BROWN, SKIN};
    use nalgebra::Isometry3;

    fn camera() -> Camera {
        Camera { eye: [0.0, 0.0, 20.0], target: [0.0; 3], vertical_fov: 0.5, width: 64, height: 48 }
    }

    fn brightness(image: &Image, x: usize, y: usize) -> u32 {
        image.rgb[3 * (y * image.width + x)..][..3].iter().map(|&c| u32::from(c)).sum()
    }

    fn drawn(strands: &[(&[[f32; 3]], ColourBy)], solid: Option<&SolidMesh>) -> Image {
        let mut scene = Scene::new(camera());
        scene.strands.extend(strands.iter().map(|(p, colour)| Strands::new(p, p.len(), *colour)));
        scene.solids.extend(solid.copied());
        render(&scene).expect("a scene that can be drawn")
    }

    #[test]
    fn a_strand_is_drawn_where_the_camera_sees_it_and_hidden_behind_a_solid() {
        let strand: Vec<[f32; 3]> = (0..5).map(|n| [0.0, n as f32 - 2.0, -3.0]).collect();
        let vertices = [[-2.0, -3.0, 0.0], [2.0, -3.0, 0.0], [2.0, 3.0, 0.0], [-2.0, 3.0, 0.0]];
        let solid = SolidMesh {
            vertices: &vertices,
            triangles: &[[0, 1, 2], [0, 2, 3]],
            world_from_solid: Isometry3::identity(),
            colour: SKIN,
        };
        let brown = (&strand[..], ColourBy::Hair(BROWN));
        let (empty, hair) = (drawn(&[], None), drawn(&[brown], None));
        assert_ne!(brightness(&hair, 32, 24), brightness(&empty, 32, 24));
        assert_eq!(brightness(&hair, 8, 24), brightness(&empty, 8, 24));
        // Whatever shadow the hair casts falls away from the viewer here.
        assert_eq!(drawn(&[brown], Some(&solid)).rgb, drawn(&[], Some(&solid)).rgb);
    }

    #[test]
    fn a_colour_that_stands_for_a_number_is_shown_as_it_is() {
        let strand: Vec<[f32; 3]> = (0..5).map(|n| [0.0, n as f32 - 2.0, -3.0]).collect();
        // Wide enough to fill the pixel looked at.
        let wide = Strands { width_cm: 1.0, ..Strands::new(&strand, strand.len(), ColourBy::Weight(&[1.0])) };
        let mut scene = Scene::new(camera());
        scene.strands.push(wide);
        let image = render(&scene).expect("a scene that can be drawn");
        let wanted = hair_viewer::heat_colour(1.0).map(|c| (c.powf(1.0 / 2.2) * 255.0 + 0.5) as u8);
        assert_eq!(image.rgb[3 * (24 * 64 + 32)..][..3], wanted);
    }

    #[test]
    fn points_that_are_not_finite_or_behind_the_camera_are_left_out() {
        let strand = [[f32::NAN; 3], [0.0, 1.0, 0.0]];
        let behind = [[0.0, 0.0, 30.0], [0.0, 1.0, 40.0]];
        let empty = drawn(&[], None);
        assert_eq!(drawn(&[(&strand, ColourBy::Hair(BROWN))], None), empty);
        assert_eq!(drawn(&[(&behind, ColourBy::Hair(BROWN))], None), empty);
    }
}
