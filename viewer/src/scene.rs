//! What a picture shows: strands, solids and how they are lit, as plain data that is only looked at.

use crate::camera::Camera;
use crate::colour::ColourBy;
use crate::error::Error;
use nalgebra::{Isometry3, Vector3};

/// Brown hair.
pub const BROWN: [f32; 3] = [0.115, 0.050, 0.021];
/// Blonde hair.
pub const BLONDE: [f32; 3] = [0.52, 0.33, 0.15];
/// Skin, for heads.
pub const SKIN: [f32; 3] = [0.60, 0.37, 0.28];
/// Horn, for combs and rods.
pub const HORN: [f32; 3] = [0.70, 0.56, 0.24];

/// The curve drawn through the particles of a strand; both begin at its root and end at its tip.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Curve {
    /// Uniform cubic B-spline (AS16 §3.1): bends without a jump, within the polygon of the particles rather than on it.
    #[default]
    BSpline,
    /// Catmull-Rom: passes through every particle; where contact is to be seen.
    Through,
}

/// How hair answers to light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Shading {
    /// Light as a fibre scatters it (Marschner et al. 2003, simplified), shadows of hair and solids, a tone curve.
    #[default]
    Hair,
    /// Colours as they are: no light, no shadow, no tone curve; for measures and image tests.
    Flat,
}

/// Strands of one look.
#[derive(Debug, Clone, Copy)]
pub struct Strands<'a> {
    /// `n_strands * n_particles` positions in the world (cm), strand-major, root first. A strand with a position that is
    /// not finite is left out.
    pub positions: &'a [[f32; 3]],
    /// Particles of each strand, at least 2.
    pub n_particles: usize,
    /// What decides the colour.
    pub colour: ColourBy<'a>,
    /// Drawn width, cm; that of real hair is about 0.008, wider where few strands stand for many.
    pub width_cm: f32,
    /// The curve through the particles.
    pub curve: Curve,
}

impl<'a> Strands<'a> {
    /// Strands of a width that lets this many of them cover a head.
    pub fn new(positions: &'a [[f32; 3]], n_particles: usize, colour: ColourBy<'a>) -> Self {
        let n_strands = positions.len() / n_particles.max(1);
        Self { positions, n_particles, colour, width_cm: Self::width_for(n_strands), curve: Curve::default() }
    }

    /// A width (cm) that lets so many strands cover a head: real hair's from 150,000 on.
    pub fn width_for(n_strands: usize) -> f32 {
        (3.1 / (n_strands.max(1) as f32).sqrt()).clamp(0.008, 0.25)
    }

    /// Strands there are.
    pub fn n_strands(&self) -> usize {
        self.positions.len() / self.n_particles.max(1)
    }

    fn check(&self) -> Result<(), Error> {
        if self.n_particles < 2 {
            let must = "at least 2";
            return Err(Error::BadValue { what: "particles of a strand", value: self.n_particles as f64, must });
        }
        let expected = self.n_strands() * self.n_particles;
        if self.positions.len() != expected {
            return Err(Error::Length { what: "the list of positions", found: self.positions.len(), expected });
        }
        if !(self.width_cm.is_finite() && self.width_cm > 0.0) {
            return Err(Error::BadValue { what: "the width of hair", value: self.width_cm.into(), must: "positive" });
        }
        Ok(())
    }
}

/// A solid to draw.
#[derive(Debug, Clone, Copy)]
pub struct SolidMesh<'a> {
    /// Positions in the solid's frame, cm.
    pub vertices: &'a [[f32; 3]],
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Where it is.
    pub world_from_solid: Isometry3<f32>,
    /// Linear red, green, blue in 0..1.
    pub colour: [f32; 3],
}

impl SolidMesh<'_> {
    fn check(&self) -> Result<(), Error> {
        let n_vertices = self.vertices.len();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= n_vertices) {
                return Err(Error::UnknownVertex { triangle, vertex, n_vertices });
            }
        }
        Ok(())
    }

    /// Positions and unit normals in the world, one per vertex; a normal is zero where there is no direction. Triangles must
    /// name vertices that are there, as [`Scene::check`] finds.
    #[must_use]
    pub fn placed(&self) -> Vec<[Vector3<f32>; 2]> {
        let mut out: Vec<_> = self
            .vertices
            .iter()
            .map(|p| [(self.world_from_solid * nalgebra::Point3::from(*p)).coords, Vector3::zeros()])
            .collect();
        for t in self.triangles {
            let [a, b, c] = t.map(|v| out[v as usize][0]);
            // Its length is twice the area, by which the triangle counts.
            let area = (b - a).cross(&(c - a));
            t.iter().for_each(|&v| out[v as usize][1] += area);
        }
        out.iter_mut().for_each(|v| v[1] = v[1].try_normalize(1e-12).unwrap_or_default());
        out
    }
}

/// All that a picture shows.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    /// From where.
    pub camera: Camera,
    /// Hair.
    pub strands: Vec<Strands<'a>>,
    /// Solids.
    pub solids: Vec<SolidMesh<'a>>,
    /// How hair answers to light.
    pub shading: Shading,
    /// Backdrop at the top and at the bottom of the picture.
    pub backdrop: [[f32; 3]; 2],
    /// Pixels drawn along each axis for one of the picture, 1 to 4, with four samples each; 2 looks smooth.
    pub supersampling: usize,
}

impl<'a> Scene<'a> {
    /// An empty scene, 16 samples a pixel.
    pub fn new(camera: Camera) -> Self {
        Self {
            camera,
            strands: Vec::new(),
            solids: Vec::new(),
            shading: Shading::Hair,
            backdrop: [[0.20, 0.22, 0.25], [0.42, 0.43, 0.45]],
            supersampling: 2,
        }
    }

    /// Whether it can be drawn at all: every renderer asks this first.
    ///
    /// # Errors
    /// The first array whose length does not fit, or number without sense.
    pub fn check(&self) -> Result<(), Error> {
        self.strands.iter().try_for_each(Strands::check)?;
        self.solids.iter().try_for_each(SolidMesh::check)?;
        let c = &self.camera;
        for (what, value) in [("the width of a picture", c.width), ("the height of a picture", c.height)] {
            if value == 0 {
                return Err(Error::BadValue { what, value: 0.0, must: "at least 1" });
            }
        }
        if !(c.vertical_fov > 0.0 && c.vertical_fov < 3.0) {
            let value = c.vertical_fov.into();
            return Err(Error::BadValue { what: "the vertical field of view", value, must: "within 0 to 3 radian" });
        }
        if c.eye.iter().chain(&c.target).any(|x| !x.is_finite()) {
            return Err(Error::BadValue { what: "the camera's place", value: f64::NAN, must: "finite" });
        }
        if !(1..=4).contains(&self.supersampling) {
            let value = self.supersampling as f64;
            return Err(Error::BadValue { what: "supersampling", value, must: "1 to 4" });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { eye: [0.0, 0.0, 20.0], target: [0.0; 3], vertical_fov: 0.5, width: 64, height: 48 }
    }

    #[test]
    fn a_scene_that_cannot_be_drawn_says_what_is_wrong() {
        let refused = |change: &dyn Fn(&mut Scene)| {
            let mut scene = Scene::new(camera());
            change(&mut scene);
            scene.check().map_err(|e| e.to_string())
        };
        assert_eq!(refused(&|_| {}), Ok(()));
        let says = |result: Result<(), String>, word: &str| result.unwrap_err().contains(word);
        assert!(says(refused(&|s| s.camera.width = 0), "width"));
        assert!(says(refused(&|s| s.camera.vertical_fov = f32::NAN), "field of view"));
        assert!(says(refused(&|s| s.camera.eye[1] = f32::INFINITY), "finite"));
        assert!(says(refused(&|s| s.supersampling = 9), "1 to 4"));
        static POINTS: [[f32; 3]; 5] = [[0.0; 3]; 5];
        assert!(says(refused(&|s| s.strands.push(Strands::new(&POINTS, 2, ColourBy::Hair(BROWN)))), "5 entries"));
        assert!(says(refused(&|s| s.strands.push(Strands::new(&POINTS, 1, ColourBy::Hair(BROWN)))), "at least 2"));
        let world_from_solid = Isometry3::identity();
        let solid = SolidMesh { vertices: &POINTS, triangles: &[[0, 1, 7]], world_from_solid, colour: SKIN };
        assert!(says(refused(&|s| s.solids.push(solid)), "vertex 7"));
    }

    #[test]
    fn normals_point_out_of_a_tetrahedron_and_turn_with_it() {
        let vertices = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]];
        let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let world_from_solid = Isometry3::new(Vector3::new(5.0, 0.0, 0.0), Vector3::new(0.3, -0.2, 0.9));
        let solid = SolidMesh { vertices: &vertices, triangles: &triangles, world_from_solid, colour: SKIN };
        for [position, normal] in solid.placed() {
            let outward = (position - world_from_solid.translation.vector).normalize();
            assert!(normal.dot(&outward) > 0.999);
        }
    }
}
