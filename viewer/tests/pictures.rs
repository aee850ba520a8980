//! Laws of the pictures a driver draws: what covers which pixels, what hides what, which colour stands for which number.
//!
//! Without feature `gpu` there is nothing to test here; without a driver every test says that it is skipped, and why.
#![cfg(feature = "gpu")]
#![allow(clippy::print_stdout, reason = "a test that is skipped says so")]

use hair_viewer::{
    BROWN, Camera, ColourBy, Curve, Error, HORN, Image, RenderProcess, Renderer, SKIN, Scene, Shading, SolidMesh,
    Strands, heat_colour, psnr, to_srgb,
};
use nalgebra::{Isometry3, Vector3};
use std::process::Command;
use std::sync::OnceLock;

/// One driver for all tests; `None`, and a word on it, where there is none.
fn renderer(test: &str) -> Option<&'static Renderer> {
    static RENDERER: OnceLock<Result<Renderer, Error>> = OnceLock::new();
    match RENDERER.get_or_init(Renderer::new) {
        Ok(renderer) => Some(renderer),
        Err(why) => {
            println!("skipped: {test}: {why}");
            None
        }
    }
}

/// Pixels of 1 mm in the plane z = 0; (0, 0) is between the four middle pixels.
fn camera() -> Camera {
    let (width, height) = (64, 48);
    let distance = 40.0;
    let vertical_fov = 2.0 * (0.05 * height as f32 / distance).atan();
    Camera { eye: [0.0, 0.0, distance], target: [0.0; 3], vertical_fov, width, height }
}

fn flat() -> Scene<'static> {
    Scene { shading: Shading::Flat, backdrop: [[0.0; 3]; 2], ..Scene::new(camera()) }
}

fn pixel(image: &Image, x: usize, y: usize) -> [u8; 3] {
    let at = 3 * (y * image.width + x);
    [image.rgb[at], image.rgb[at + 1], image.rgb[at + 2]]
}

/// Sum of the linear values of a picture's red channel: how much of a white thing on black it shows, in pixels.
fn whiteness(image: &Image) -> f64 {
    let linear = |byte: u8| {
        let c = f64::from(byte) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    };
    image.rgb.iter().step_by(3).map(|&byte| linear(byte)).sum()
}

fn upright(x: f32, z: f32) -> Vec<[f32; 3]> {
    (0..9).map(|i| [x, 2.0 - 0.5 * i as f32, z]).collect()
}

fn square(z: f32) -> [[f32; 3]; 4] {
    [[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]]
}

const TWO_TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];

fn solid(vertices: &[[f32; 3]]) -> SolidMesh<'_> {
    SolidMesh { vertices, triangles: &TWO_TRIANGLES, world_from_solid: Isometry3::identity(), colour: HORN }
}

/// A tuft with curls, a wall and a colour of hair: everything that a picture can show.
fn busy(points: &[[f32; 3]]) -> Scene<'_> {
    let mut scene = Scene::new(camera());
    scene.strands.push(Strands::new(points, 12, ColourBy::Hair(BROWN)));
    scene
}

fn tuft() -> Vec<[f32; 3]> {
    let strand = |s: usize| {
        (0..12).map(move |i| {
            let (a, b) = (s as f32 * 2.4, i as f32 * 0.6 + s as f32);
            let r = 0.05 * (s as f32).sqrt();
            [r * a.cos() + 0.1 * b.cos(), 2.0 - 0.35 * i as f32, r * a.sin() + 0.1 * b.sin()]
        })
    };
    (0..400).flat_map(strand).collect()
}

#[test]
fn one_driver_draws_one_scene_twice_to_the_same_bytes() {
    let Some(renderer) = renderer("one_driver_draws_one_scene_twice_to_the_same_bytes") else { return };
    let points = tuft();
    let wall = square(-2.0);
    let mut scene = busy(&points);
    scene.solids.push(solid(&wall));
    let first = renderer.picture(&scene).unwrap();
    assert_eq!(psnr(&first, &renderer.picture(&scene).unwrap()).unwrap(), f64::INFINITY);
    let again = Renderer::new().unwrap().picture(&scene).unwrap();
    assert_eq!(first, again, "a renderer made anew");
    // And it does show something: two seeds of the tuft are not the same picture.
    let other: Vec<[f32; 3]> = points.iter().map(|p| [-p[0], p[1], p[2]]).collect();
    assert!(psnr(&first, &renderer.picture(&busy(&other)).unwrap()).unwrap() < 40.0);
}

#[test]
fn an_upright_strand_covers_its_pixels_and_no_others() {
    let Some(renderer) = renderer("an_upright_strand_covers_its_pixels_and_no_others") else { return };
    let points = upright(0.05, 0.0);
    let mut scene = flat();
    // Four pixels wide over its untapered part, from 30.5 to 34.5; white.
    scene.strands.push(Strands { width_cm: 0.4, ..Strands::new(&points, 9, ColourBy::Hair([1.0; 3])) });
    for curve in [Curve::BSpline, Curve::Through] {
        scene.strands[0].curve = curve;
        let image = renderer.picture(&scene).unwrap();
        for y in 0..48 {
            for x in 0..64 {
                let [red, ..] = pixel(&image, x, y);
                // From 2 cm above the middle to 2 cm below it: rows 4 to 43.
                let in_height = (4..44).contains(&y);
                if !in_height || !(30..35).contains(&x) {
                    assert_eq!(red, 0, "{curve:?} at {x}, {y}");
                } else if (31..34).contains(&x) && y < 28 {
                    assert_eq!(red, 255, "{curve:?} at {x}, {y}");
                } else if y < 28 {
                    // Half covered: half the light.
                    assert!((100..230).contains(&red), "{curve:?} at {x}, {y}: {red}");
                }
            }
        }
    }
}

#[test]
fn a_strand_thinner_than_a_pixel_shows_as_much_as_it_covers() {
    let Some(renderer) = renderer("a_strand_thinner_than_a_pixel_shows_as_much_as_it_covers") else { return };
    // Sixteen samples a pixel over forty rows of sixteen strands: the mean is far nearer than any pixel.
    const SAMPLING: f64 = 0.06;
    let points: Vec<[f32; 3]> = (0..16)
        .flat_map(|s| (0..9).map(move |i| [0.37 * s as f32 - 2.7 + 0.013 * i as f32, 2.0 - 0.5 * i as f32, 0.0]))
        .collect();
    let shown = |width_cm: f32| {
        let mut scene = flat();
        scene.strands.push(Strands { width_cm, ..Strands::new(&points, 9, ColourBy::Hair([1.0; 3])) });
        whiteness(&renderer.picture(&scene).unwrap())
    };
    let wide = shown(0.1);
    for share in [0.5, 0.25, 0.1] {
        let thin = shown(0.1 * share);
        let expected = f64::from(share) * wide;
        assert!((thin / expected - 1.0).abs() < SAMPLING, "a width of {share}: {thin} instead of {expected}");
    }
}

#[test]
fn hair_behind_a_solid_is_hidden_and_before_it_seen() {
    let Some(renderer) = renderer("hair_behind_a_solid_is_hidden_and_before_it_seen") else { return };
    let wall = square(0.0);
    let draw = |points: Option<&[[f32; 3]]>| {
        let mut scene = flat();
        scene.solids.push(solid(&wall));
        scene.strands.extend(points.map(|p| Strands::new(p, 5, ColourBy::Hair([1.0, 0.0, 0.0]))));
        renderer.picture(&scene).unwrap()
    };
    let strand = |z: f32| -> Vec<[f32; 3]> { (0..5).map(|i| [0.0, 0.4 - 0.2 * i as f32, z]).collect() };
    let alone = draw(None);
    assert_eq!(pixel(&alone, 32, 24), HORN.map(to_srgb));
    assert_eq!(draw(Some(&strand(-1.0))), alone);
    assert_ne!(draw(Some(&strand(1.0))), alone);
}

#[test]
fn a_solid_is_drawn_where_its_pose_puts_it() {
    let Some(renderer) = renderer("a_solid_is_drawn_where_its_pose_puts_it") else { return };
    let wall = square(0.0);
    let mut scene = flat();
    scene.solids.push(SolidMesh { world_from_solid: Isometry3::translation(2.0, -1.0, 0.0), ..solid(&wall) });
    let image = renderer.picture(&scene).unwrap();
    // 1 to 3 cm to the right, 0 to 2 cm down.
    for (x, y, inside) in [(43, 25, true), (60, 42, true), (40, 25, false), (43, 22, false), (63, 30, false)] {
        assert_eq!(pixel(&image, x, y) == HORN.map(to_srgb), inside, "at {x}, {y}");
    }
}

#[test]
fn known_speeds_are_drawn_in_known_colours() {
    let Some(renderer) = renderer("known_speeds_are_drawn_in_known_colours") else { return };
    // Bytes are rounded twice: once to the ten bits in which colours travel, once for the picture.
    const ROUNDED_TWICE: u8 = 2;
    let mut points = upright(-1.0, 0.0);
    points.extend(upright(1.0, 0.0));
    let speeds: Vec<f32> = std::iter::repeat_n(25.0, 9).chain((0..9).map(|i| 12.5 * i as f32)).collect();
    let mut scene = flat();
    let colour = ColourBy::Velocity { speeds: &speeds, fastest: 100.0 };
    scene.strands.push(Strands { width_cm: 0.6, ..Strands::new(&points, 9, colour) });
    let image = renderer.picture(&scene).unwrap();
    let check = |x: usize, y: usize, share: f32| {
        let (found, expected) = (pixel(&image, x, y), heat_colour(share).map(to_srgb));
        for c in 0..3 {
            assert!(found[c].abs_diff(expected[c]) <= ROUNDED_TWICE, "at {x}, {y}: {found:?}, not {expected:?}");
        }
    };
    [8, 20, 33].into_iter().for_each(|y| check(22, y, 0.25));
    // Row y shows the middle of its millimetre: 2 cm above the middle is speed 0, 2 cm below it 100.
    [8, 14, 20, 24, 33, 42].into_iter().for_each(|y| check(42, y, (y as f32 + 0.5 - 4.0) / 40.0));
}

#[test]
fn a_b_spline_stays_within_the_polygon_that_catmull_rom_passes_through() {
    let Some(renderer) = renderer("a_b_spline_stays_within_the_polygon_that_catmull_rom_passes_through") else {
        return;
    };
    let points: Vec<[f32; 3]> =
        (0..9).map(|i| [if i % 2 == 0 { -1.0 } else { 1.0 }, 1.6 - 0.4 * i as f32, 0.0]).collect();
    let mut scene = flat();
    scene.strands.push(Strands { width_cm: 0.1, ..Strands::new(&points, 9, ColourBy::Hair([1.0; 3])) });
    let mut reach = |curve| {
        scene.strands[0].curve = curve;
        let image = renderer.picture(&scene).unwrap();
        // Within the rows of inner particles: the ends are on the polygon either way.
        let lit = |x: &usize| (14..34).any(|y| pixel(&image, *x, y)[0] > 0);
        (0..64).filter(lit).map(|x| x.abs_diff(32)).max().unwrap()
    };
    // A zigzag of 1 cm has a B-spline of a third of that.
    assert!((10..=12).contains(&reach(Curve::Through)));
    assert!((3..=5).contains(&reach(Curve::BSpline)));
}

#[test]
fn hair_darkens_what_lies_behind_it() {
    let Some(renderer) = renderer("hair_darkens_what_lies_behind_it") else { return };
    // A wall, and a curtain of hair out of the camera's sight between it and the key light.
    let wall: Vec<[f32; 3]> = square(0.0).map(|p| [3.0 * p[0], 3.0 * p[1], p[2]]).to_vec();
    let curtain = |n: usize| -> Vec<[f32; 3]> {
        let toward = Vector3::new(-0.55f32, 0.75, 0.8).normalize() * 12.0;
        (0..n)
            .flat_map(|s| {
                (0..9).map(move |i| toward + Vector3::new(3.0 * s as f32 / n as f32 - 1.5, 1.5 - 0.37 * i as f32, 0.0))
            })
            .map(Into::into)
            .collect()
    };
    let brightness = |n: usize| {
        let points = curtain(n);
        let mut scene = Scene::new(camera());
        scene.solids.push(solid(&wall));
        scene.strands.push(Strands { width_cm: 0.02, ..Strands::new(&points, 9, ColourBy::Hair(BROWN)) });
        let image = renderer.picture(&scene).unwrap();
        pixel(&image, 32, 24).iter().map(|&c| u32::from(c)).sum::<u32>()
    };
    let (none, some, much) = (brightness(0), brightness(150), brightness(3000));
    assert!(none > some && some > much, "{none}, {some}, {much}");
}

#[test]
fn strands_that_are_not_finite_or_behind_the_camera_are_left_out() {
    let Some(renderer) = renderer("strands_that_are_not_finite_or_behind_the_camera_are_left_out") else { return };
    let draw = |points: &[[f32; 3]]| {
        let mut scene = flat();
        scene.strands.push(Strands::new(points, points.len().max(2), ColourBy::Hair([1.0; 3])));
        renderer.picture(&scene).unwrap()
    };
    let empty = draw(&[]);
    let mut torn = upright(0.0, 0.0);
    assert_ne!(draw(&torn), empty);
    torn[8][1] = f32::INFINITY;
    assert_eq!(draw(&torn), empty, "a strand whose tip alone is lost");
    assert_eq!(draw(&[[f32::NAN; 3], [0.0, 1.0, 0.0]]), empty);
    assert_eq!(draw(&[[0.0, 0.0, 60.0], [0.0, 1.0, 70.0]]), empty);
    assert_eq!(draw(&[[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]), empty, "a strand without length");
    assert_ne!(draw(&[[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]), empty);
}

#[test]
fn more_strands_than_one_batch_are_all_drawn() {
    let Some(renderer) = renderer("more_strands_than_one_batch_are_all_drawn") else { return };
    // Two particles, many pieces never: over half a million strands in a row, each a hundredth of a pixel apart.
    let n = 700_000;
    let points: Vec<[f32; 3]> = (0..n)
        .flat_map(|s| {
            let x = 6.0 * s as f32 / n as f32 - 3.0;
            [[x, 0.05, 0.0], [x, -0.05, 0.0]]
        })
        .collect();
    let mut scene = flat();
    scene.strands.push(Strands { width_cm: 0.001, ..Strands::new(&points, 2, ColourBy::Hair([1.0; 3])) });
    let image = renderer.picture(&scene).unwrap();
    assert!((3..61).all(|x| pixel(&image, x, 23)[0] > 0 && pixel(&image, x, 24)[0] > 0));
}

#[test]
fn a_renderer_in_a_program_of_its_own_draws_the_same_bytes() {
    let Some(renderer) = renderer("a_renderer_in_a_program_of_its_own_draws_the_same_bytes") else { return };
    let points = tuft();
    let wall = square(-2.0);
    let mut scene = busy(&points);
    scene.solids.push(solid(&wall));
    let mut process = RenderProcess::start(Command::new(env!("CARGO_BIN_EXE_hair-draw"))).unwrap();
    assert_eq!(process.adapter(), renderer.adapter());
    assert_eq!(process.picture(&scene).unwrap(), renderer.picture(&scene).unwrap());
    // What it refuses it says, and goes on.
    scene.camera.width = 1 << 20;
    let refused = process.picture(&scene).unwrap_err().to_string();
    assert!(refused.contains("2097152"), "{refused}");
    scene.camera.width = 32;
    assert_eq!(process.picture(&scene).unwrap().width, 32);
}

#[test]
fn what_a_driver_cannot_hold_is_refused_with_the_numbers() {
    let Some(renderer) = renderer("what_a_driver_cannot_hold_is_refused_with_the_numbers") else { return };
    let mut scene = flat();
    scene.camera.width = 1 << 20;
    let refused = renderer.picture(&scene).unwrap_err();
    assert!(matches!(refused, Error::TooLarge { needed: 2_097_152, .. }), "{refused}");
    (scene.camera.width, scene.camera.height) = (8000, 7000);
    let refused = renderer.picture(&scene).unwrap_err();
    assert!(matches!(refused, Error::TooLarge { needed, .. } if needed > 10 << 30), "{refused}");
    // And the driver goes on drawing.
    let wall = square(0.0);
    let mut scene = flat();
    scene.solids.push(SolidMesh { colour: SKIN, ..solid(&wall) });
    assert_eq!(pixel(&renderer.picture(&scene).unwrap(), 32, 24), SKIN.map(to_srgb));
}
