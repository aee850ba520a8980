//! Scenes and pictures as bytes between two programs of one build: little-endian, in the order of the fields.
//!
//! Not a file format: both ends are this crate, at one version. What is read is checked as any scene is before it is drawn.

use crate::camera::Camera;
use crate::colour::ColourBy;
use crate::image::Image;
use crate::scene::{Curve, Scene, Shading, SolidMesh, Strands};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::io::{Error, ErrorKind, Read, Result, Write};

/// Colours with their numbers, owned.
enum OwnedColour {
    Hair([f32; 3]),
    Strand(Vec<[f32; 3]>),
    Guide(Vec<u32>),
    Weight(Vec<f32>),
    Penetration(Vec<f32>, f32),
    Velocity(Vec<f32>, f32),
}

struct OwnedStrands {
    positions: Vec<[f32; 3]>,
    n_particles: usize,
    colour: OwnedColour,
    width_cm: f32,
    curve: Curve,
}

struct OwnedSolid {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    world_from_solid: Isometry3<f32>,
    colour: [f32; 3],
}

/// A scene with all it shows, as it came over the wire.
pub(crate) struct OwnedScene {
    camera: Camera,
    shading: Shading,
    backdrop: [[f32; 3]; 2],
    supersampling: usize,
    strands: Vec<OwnedStrands>,
    solids: Vec<OwnedSolid>,
}

impl OwnedScene {
    pub fn view(&self) -> Scene<'_> {
        let strands = self.strands.iter().map(|s| Strands {
            positions: &s.positions,
            n_particles: s.n_particles,
            colour: match &s.colour {
                OwnedColour::Hair(c) => ColourBy::Hair(*c),
                OwnedColour::Strand(colours) => ColourBy::Strand(colours),
                OwnedColour::Guide(guides) => ColourBy::Guide(guides),
                OwnedColour::Weight(weights) => ColourBy::Weight(weights),
                OwnedColour::Penetration(depths, worst_cm) => ColourBy::Penetration { depths, worst_cm: *worst_cm },
                OwnedColour::Velocity(speeds, fastest) => ColourBy::Velocity { speeds, fastest: *fastest },
            },
            width_cm: s.width_cm,
            curve: s.curve,
        });
        let solids = self.solids.iter().map(|s| SolidMesh {
            vertices: &s.vertices,
            triangles: &s.triangles,
            world_from_solid: s.world_from_solid,
            colour: s.colour,
        });
        Scene {
            camera: self.camera,
            strands: strands.collect(),
            solids: solids.collect(),
            shading: self.shading,
            backdrop: self.backdrop,
            supersampling: self.supersampling,
        }
    }
}

fn put_words(to: &mut impl Write, words: &[u32]) -> Result<()> {
    words.iter().try_for_each(|w| to.write_all(&w.to_le_bytes()))
}

fn put_floats(to: &mut impl Write, floats: &[f32]) -> Result<()> {
    floats.iter().try_for_each(|x| to.write_all(&x.to_le_bytes()))
}

fn put_length(to: &mut impl Write, length: usize) -> Result<()> {
    to.write_all(&(length as u64).to_le_bytes())
}

fn put_list(to: &mut impl Write, floats: &[f32]) -> Result<()> {
    put_length(to, floats.len())?;
    put_floats(to, floats)
}

pub(crate) fn write_scene(to: &mut impl Write, scene: &Scene) -> Result<()> {
    let c = &scene.camera;
    put_floats(to, &c.eye)?;
    put_floats(to, &c.target)?;
    put_floats(to, &[c.vertical_fov])?;
    [c.width, c.height, scene.supersampling].into_iter().try_for_each(|n| put_length(to, n))?;
    put_words(to, &[u32::from(scene.shading == Shading::Flat)])?;
    put_floats(to, scene.backdrop.as_flattened())?;
    put_length(to, scene.strands.len())?;
    for s in &scene.strands {
        put_list(to, s.positions.as_flattened())?;
        put_length(to, s.n_particles)?;
        put_floats(to, &[s.width_cm])?;
        put_words(to, &[u32::from(s.curve == Curve::Through)])?;
        match s.colour {
            ColourBy::Hair(colour) => {
                put_words(to, &[0])?;
                put_floats(to, &colour)?;
            }
            ColourBy::Strand(colours) => {
                put_words(to, &[5])?;
                put_list(to, colours.as_flattened())?;
            }
            ColourBy::Guide(guides) => {
                put_words(to, &[1])?;
                put_length(to, guides.len())?;
                put_words(to, guides)?;
            }
            ColourBy::Weight(weights) => {
                put_words(to, &[2])?;
                put_list(to, weights)?;
            }
            ColourBy::Penetration { depths: list, worst_cm: most } => {
                put_words(to, &[3])?;
                put_list(to, list)?;
                put_floats(to, &[most])?;
            }
            ColourBy::Velocity { speeds: list, fastest: most } => {
                put_words(to, &[4])?;
                put_list(to, list)?;
                put_floats(to, &[most])?;
            }
        }
    }
    put_length(to, scene.solids.len())?;
    for s in &scene.solids {
        put_list(to, s.vertices.as_flattened())?;
        put_length(to, s.triangles.len())?;
        put_words(to, s.triangles.as_flattened())?;
        put_floats(to, s.world_from_solid.translation.vector.as_slice())?;
        put_floats(to, s.world_from_solid.rotation.coords.as_slice())?;
        put_floats(to, &s.colour)?;
    }
    to.flush()
}

fn get<const N: usize>(from: &mut impl Read) -> Result<[u8; N]> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn get_word(from: &mut impl Read) -> Result<u32> {
    Ok(u32::from_le_bytes(get(from)?))
}

fn get_floats<const N: usize>(from: &mut impl Read) -> Result<[f32; N]> {
    let mut floats = [0.0; N];
    for x in &mut floats {
        *x = f32::from_le_bytes(get(from)?);
    }
    Ok(floats)
}

fn get_length(from: &mut impl Read) -> Result<usize> {
    usize::try_from(u64::from_le_bytes(get(from)?)).map_err(|e| Error::new(ErrorKind::InvalidData, e))
}

/// So many words of four bytes; the list grows as they come, so that a length that lies cannot exhaust the memory.
fn get_list<T>(from: &mut impl Read, length: usize, of: impl Fn([u8; 4]) -> T) -> Result<Vec<T>> {
    let mut bytes = Vec::new();
    from.take(4 * length as u64).read_to_end(&mut bytes)?;
    if bytes.len() != 4 * length {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    Ok(bytes.as_chunks().0.iter().map(|&word| of(word)).collect())
}

fn get_float_list(from: &mut impl Read) -> Result<Vec<f32>> {
    let length = get_length(from)?;
    get_list(from, length, f32::from_le_bytes)
}

fn in_threes<T: Copy>(list: &[T]) -> Vec<[T; 3]> {
    list.as_chunks().0.to_vec()
}

fn unknown(what: &str) -> Error {
    Error::new(ErrorKind::InvalidData, format!("an unknown {what}"))
}

pub(crate) fn read_scene(from: &mut impl Read) -> Result<OwnedScene> {
    let (eye, target, [vertical_fov]) = (get_floats(from)?, get_floats(from)?, get_floats(from)?);
    let (width, height, supersampling) = (get_length(from)?, get_length(from)?, get_length(from)?);
    let shading = if get_word(from)? == 0 { Shading::Hair } else { Shading::Flat };
    let backdrop = [get_floats(from)?, get_floats(from)?];
    let mut scene = OwnedScene {
        camera: Camera { eye, target, vertical_fov, width, height },
        shading,
        backdrop,
        supersampling,
        strands: Vec::new(),
        solids: Vec::new(),
    };
    for _ in 0..get_length(from)? {
        let positions = in_threes(&get_float_list(from)?);
        let (n_particles, [width_cm]) = (get_length(from)?, get_floats(from)?);
        let curve = if get_word(from)? == 0 { Curve::BSpline } else { Curve::Through };
        let colour = match get_word(from)? {
            0 => OwnedColour::Hair(get_floats(from)?),
            1 => {
                let length = get_length(from)?;
                OwnedColour::Guide(get_list(from, length, u32::from_le_bytes)?)
            }
            2 => OwnedColour::Weight(get_float_list(from)?),
            3 => OwnedColour::Penetration(get_float_list(from)?, get_floats::<1>(from)?[0]),
            4 => OwnedColour::Velocity(get_float_list(from)?, get_floats::<1>(from)?[0]),
            5 => OwnedColour::Strand(in_threes(&get_float_list(from)?)),
            _ => return Err(unknown("way to colour")),
        };
        scene.strands.push(OwnedStrands { positions, n_particles, colour, width_cm, curve });
    }
    for _ in 0..get_length(from)? {
        let vertices = in_threes(&get_float_list(from)?);
        let length = get_length(from)?.checked_mul(3).ok_or_else(|| unknown("number of triangles"))?;
        let triangles = in_threes(&get_list(from, length, u32::from_le_bytes)?);
        let (shift, turn): ([f32; 3], [f32; 4]) = (get_floats(from)?, get_floats(from)?);
        let turn = UnitQuaternion::new_unchecked(Quaternion::from(turn));
        let world_from_solid = Isometry3::from_parts(Translation3::from(shift), turn);
        scene.solids.push(OwnedSolid { vertices, triangles, world_from_solid, colour: get_floats(from)? });
    }
    Ok(scene)
}

/// A picture, or why there is none; also the greeting, which says who draws.
pub(crate) enum Answer {
    Name(String),
    Failed(String),
    Picture(Image),
}

pub(crate) fn write_answer(to: &mut impl Write, answer: &Answer) -> Result<()> {
    let (kind, bytes) = match answer {
        Answer::Name(name) => (0, name.as_bytes()),
        Answer::Failed(why) => (1, why.as_bytes()),
        Answer::Picture(image) => (2, &image.rgb[..]),
    };
    put_words(to, &[kind])?;
    if let Answer::Picture(image) = answer {
        put_length(to, image.width)?;
        put_length(to, image.height)?;
    }
    put_length(to, bytes.len())?;
    to.write_all(bytes)?;
    to.flush()
}

pub(crate) fn read_answer(from: &mut impl Read) -> Result<Answer> {
    let kind = get_word(from)?;
    let size = if kind == 2 { [get_length(from)?, get_length(from)?] } else { [0; 2] };
    let length = get_length(from)?;
    let mut bytes = Vec::new();
    from.take(length as u64).read_to_end(&mut bytes)?;
    if bytes.len() != length {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
    match kind {
        0 => Ok(Answer::Name(text(&bytes))),
        1 => Ok(Answer::Failed(text(&bytes))),
        2 => Ok(Answer::Picture(Image { width: size[0], height: size[1], rgb: bytes })),
        _ => Err(unknown("answer")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{BROWN, HORN};

    #[test]
    fn a_scene_comes_over_the_wire_as_it_went_in_and_a_torn_one_not_at_all() {
        let points: Vec<[f32; 3]> = (0..6).map(|i| [i as f32, -0.5, f32::NAN]).collect();
        let numbers = [0.5, -0.25, 3.0, 0.0, 1.0, 7.0];
        let world_from_solid = Isometry3::new([1.0, 2.0, 3.0].into(), [0.1, -0.7, 0.3].into());
        let mut scene = Scene::new(Camera::around([1.0, 2.0, 3.0], 40.0, 0.3, 31, 17));
        scene.shading = Shading::Flat;
        for colour in [
            ColourBy::Hair(BROWN),
            ColourBy::Strand(&[BROWN, HORN]),
            ColourBy::Guide(&[3, 70_000]),
            ColourBy::Weight(&numbers[..2]),
            ColourBy::Penetration { depths: &numbers, worst_cm: 0.2 },
            ColourBy::Velocity { speeds: &numbers, fastest: 30.0 },
        ] {
            scene.strands.push(Strands { curve: Curve::Through, ..Strands::new(&points, 3, colour) });
        }
        let triangles = [[0, 1, 2], [2, 3, 5]];
        scene.solids.push(SolidMesh { vertices: &points, triangles: &triangles, world_from_solid, colour: HORN });
        let mut bytes = Vec::new();
        write_scene(&mut bytes, &scene).unwrap();
        let back = read_scene(&mut &bytes[..]).unwrap();
        // Numbers that are none are not equal to themselves; as words on paper they are.
        assert_eq!(format!("{:?}", back.view()), format!("{scene:?}"));
        for end in [0, 3, 40, bytes.len() / 2, bytes.len() - 1] {
            assert!(read_scene(&mut &bytes[..end]).is_err(), "torn at {end}");
        }
    }

    #[test]
    fn answers_come_over_the_wire_as_they_went_in() {
        let image = Image { width: 3, height: 2, rgb: (0..18).collect() };
        let mut bytes = Vec::new();
        write_answer(&mut bytes, &Answer::Failed("no".to_owned())).unwrap();
        write_answer(&mut bytes, &Answer::Picture(image.clone())).unwrap();
        let mut from = &bytes[..];
        assert!(matches!(read_answer(&mut from).unwrap(), Answer::Failed(why) if why == "no"));
        assert!(matches!(read_answer(&mut from).unwrap(), Answer::Picture(back) if back == image));
        assert!(read_answer(&mut from).is_err());
    }
}
