//! Laws of the files that are our own: the envelope, frame stores and skinning models, whole and damaged.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

mod common;

use std::path::Path;

use common::model;
use io_formats::envelope::{self, HEADER_BYTES, Kind};
use io_formats::guide_transform::Blend;
use io_formats::skinning_model;
use io_formats::{
    Error, FrameInfo, FrameSource, FrameStore, FrameStoreWriter, MemoryFrames, SkinningModel, WeightPoly,
};

const VERSION: u32 = 3;
const STORE_HEADER_BYTES: usize = 64;
/// An entry of the index of a frame store, and its checksum.
const INDEX_BYTES: usize = 8;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// The error of reading `bytes` as an envelope of the skinning model's kind and version 3.
fn envelope_error(bytes: &[u8]) -> Error {
    let folder = folder();
    let path = folder.path().join("damaged");
    std::fs::write(&path, bytes).unwrap();
    envelope::read(&path, Kind::SKINNING_MODEL, VERSION).unwrap_err()
}

fn envelope_bytes() -> Vec<u8> {
    let folder = folder();
    let path = folder.path().join("whole");
    envelope::write(&path, Kind::SKINNING_MODEL, VERSION, b"payload").unwrap();
    assert_eq!(envelope::read(&path, Kind::SKINNING_MODEL, VERSION).unwrap(), b"payload");
    std::fs::read(&path).unwrap()
}

#[test]
fn a_file_appears_whole_and_leaves_nothing_beside_it() {
    let folder = folder();
    let path = folder.path().join("a.model");
    envelope::write(&path, Kind::SKINNING_MODEL, VERSION, b"old").unwrap();
    envelope::write(&path, Kind::SKINNING_MODEL, VERSION, b"").unwrap();
    assert_eq!(envelope::read(&path, Kind::SKINNING_MODEL, VERSION).unwrap(), b"");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn every_cut_of_an_envelope_is_refused_by_cause() {
    let whole = envelope_bytes();
    assert_eq!(whole.len(), HEADER_BYTES + 7);
    for n in 0..whole.len() {
        let error = envelope_error(&whole[..n]);
        match n {
            0 => assert!(matches!(error, Error::BadMagic { .. }), "{error}"),
            1..HEADER_BYTES => assert!(matches!(error, Error::Truncated { .. }), "{n}: {error}"),
            _ => assert!(matches!(error, Error::WrongLength { promised: 7, .. }), "{n}: {error}"),
        }
    }
}

#[test]
fn every_flipped_byte_of_an_envelope_is_refused() {
    let whole = envelope_bytes();
    for i in 0..whole.len() {
        let mut b = whole.clone();
        b[i] ^= 0x40;
        let error = envelope_error(&b);
        let as_expected = match i {
            0..8 => matches!(error, Error::BadMagic { .. }),
            8..12 => matches!(error, Error::WrongKind { .. }),
            12..16 => matches!(error, Error::UnsupportedVersion { .. }),
            16..24 => matches!(error, Error::WrongLength { .. }),
            _ => matches!(error, Error::Checksum { .. }),
        };
        assert!(as_expected, "byte {i}: {error}");
    }
}

#[test]
fn errors_of_an_envelope_say_what_to_do() {
    let mut b = envelope_bytes();
    b[12] = 1;
    assert!(envelope_error(&b).to_string().contains("version 1 is not supported; it is older"));
    b[12] = 9;
    assert!(envelope_error(&b).to_string().contains("newer than this program"));
    b[8..12].copy_from_slice(b"FRAM");
    assert!(envelope_error(&b).to_string().contains("holds a frame store, but a skinning model was expected"));
    // A length that would not fit any memory.
    let mut b = envelope_bytes();
    b[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(envelope_error(&b).to_string().contains("promises 18446744073709551615 bytes"));
}

fn frame(f: usize) -> (FrameInfo, Vec<[f32; 3]>) {
    let info = FrameInfo { sequence: f as u32 / 2, time_s: 0.04 * f as f64 };
    (info, (0..6).map(|i| [f as f32, i as f32, -0.5]).collect())
}

fn write_store(path: &Path, n_frames: usize) {
    let mut writer = FrameStoreWriter::create(path, 2, 3, 77).unwrap();
    for f in 0..n_frames {
        let (info, points) = frame(f);
        writer.append(info, &points).unwrap();
    }
    assert!(!path.exists(), "a store takes its name only when finished");
    writer.finish().unwrap();
}

fn check_frames(source: &dyn FrameSource, n_frames: usize) {
    assert_eq!((source.n_strands(), source.n_particles(), source.n_frames()), (2, 3, n_frames));
    let mut out = vec![[0.0; 3]; 6];
    for f in (0..n_frames).rev() {
        let (info, points) = frame(f);
        source.read(f, &mut out).unwrap();
        assert_eq!((source.info(f), &out), (info, &points));
    }
    assert!(matches!(source.read(n_frames, &mut out), Err(Error::BadFrame { .. })));
    assert!(matches!(source.read(0, &mut out[..5]), Err(Error::BadFrame { .. })));
}

#[test]
fn frames_come_back_in_any_order_from_memory_and_from_disk() {
    let mut memory = MemoryFrames::new(2, 3);
    for f in 0..5 {
        let (info, points) = frame(f);
        memory.push(info, &points).unwrap();
    }
    check_frames(&memory, 5);
    assert!(memory.push(frame(0).0, &[[0.0; 3]; 5]).is_err());

    let folder = folder();
    let path = folder.path().join("a.frames");
    write_store(&path, 5);
    let store = FrameStore::open(&path).unwrap();
    assert_eq!(store.provenance(), 77);
    check_frames(&store, 5);
    std::thread::scope(|s| {
        for _ in 0..4 {
            s.spawn(|| check_frames(&store, 5));
        }
    });
}

#[test]
fn every_cut_of_a_frame_store_is_refused() {
    let folder = folder();
    let path = folder.path().join("a.frames");
    write_store(&path, 2);
    let whole = std::fs::read(&path).unwrap();
    for n in 0..whole.len() {
        std::fs::write(&path, &whole[..n]).unwrap();
        let error = FrameStore::open(&path).unwrap_err();
        let as_expected = match n {
            0 => matches!(error, Error::BadMagic { .. }),
            1..STORE_HEADER_BYTES => matches!(error, Error::Truncated { .. }),
            _ => matches!(error, Error::WrongLength { .. } | Error::Checksum { .. }),
        };
        assert!(as_expected, "{n} bytes: {error}");
    }
    std::fs::write(&path, [whole.as_slice(), b"more"].concat()).unwrap();
    assert!(matches!(FrameStore::open(&path), Err(Error::Checksum { .. })));
}

#[test]
fn a_damaged_frame_is_named_and_hides_no_other() {
    let folder = folder();
    let path = folder.path().join("a.frames");
    write_store(&path, 3);
    let whole = std::fs::read(&path).unwrap();
    // All three are of one length.
    let index = whole.len() - INDEX_BYTES * 3 - INDEX_BYTES;
    let chunk = (index - STORE_HEADER_BYTES) / 3;
    let mut out = vec![[0.0; 3]; 6];
    for i in 0..whole.len() {
        let mut b = whole.clone();
        b[i] ^= 1;
        std::fs::write(&path, &b).unwrap();
        if i < STORE_HEADER_BYTES || i >= index {
            assert!(FrameStore::open(&path).is_err(), "byte {i}");
            continue;
        }
        let store = FrameStore::open(&path).unwrap();
        for f in 0..3 {
            let result = store.read(f, &mut out);
            if f == (i - STORE_HEADER_BYTES) / chunk {
                assert!(result.unwrap_err().to_string().contains(&format!("checksum of frame {f}")), "byte {i}");
            } else {
                result.unwrap();
            }
        }
    }
}

#[test]
fn an_interrupted_store_goes_on_after_its_last_whole_frame_with_the_same_bytes() {
    let folder = folder();
    let (path, straight) = (folder.path().join("a.frames"), folder.path().join("b.frames"));
    write_store(&straight, 4);
    let whole = std::fs::read(&straight).unwrap();
    let chunk = (whole.len() - STORE_HEADER_BYTES - INDEX_BYTES * 5) / 4;
    // What a killed recorder leaves: the unfinished header, two frames and part of a third.
    let temporary = folder.path().join("a.frames.tmp");
    drop(FrameStoreWriter::create(&path, 2, 3, 77).unwrap());
    let mut left = std::fs::read(&temporary).unwrap();
    left.extend_from_slice(&whole[STORE_HEADER_BYTES..STORE_HEADER_BYTES + 2 * chunk + 11]);
    std::fs::write(&temporary, &left).unwrap();

    let mut writer = FrameStoreWriter::resume(&path, 2, 3, 77).unwrap();
    assert_eq!(writer.infos(), [frame(0).0, frame(1).0]);
    for f in 2..4 {
        let (info, points) = frame(f);
        writer.append(info, &points).unwrap();
    }
    writer.finish().unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), whole);

    std::fs::write(&temporary, &left).unwrap();
    assert!(FrameStoreWriter::resume(&path, 2, 3, 78).unwrap().infos().is_empty(), "other inputs start afresh");
    std::fs::rename(&temporary, &path).unwrap();
    assert!(FrameStore::open(&path).unwrap_err().to_string().contains("never finished"));
}

#[test]
fn frames_that_are_not_finite_or_of_another_size_are_not_written() {
    let folder = folder();
    let path = folder.path().join("a.frames");
    let mut writer = FrameStoreWriter::create(&path, 2, 3, 0).unwrap();
    let (info, mut points) = frame(0);
    assert!(writer.append(info, &points[..5]).is_err());
    points[4][1] = f32::INFINITY;
    assert!(writer.append(info, &points).unwrap_err().to_string().contains("frame 0, strand 1"));
    assert!(writer.append(FrameInfo { time_s: f64::NAN, ..info }, &frame(0).1).is_err());
    assert!(FrameStoreWriter::create(&path, 0, 3, 0).is_err());
}

#[test]
fn a_model_comes_back_as_it_was_saved() {
    let folder = folder();
    let path = folder.path().join("a.model");
    let model = model();
    model.save(&path).unwrap();
    assert_eq!(SkinningModel::load(&path).unwrap(), model);
    assert_eq!(model.eligible_of(1), [0, 1]);
    let sets = model.sets_of(1);
    assert_eq!((sets.masks, sets.stand_in, sets.coeff_start), (&[1, 2, 3][..], &[0, 1, 2][..], &[1, 2, 3][..]));
    assert_eq!(model.weights_of_set(3).map(|w| w.at(0.7)).collect::<Vec<_>>(), [0.5, 0.5]);
    assert_eq!(model.rest_of(2)[1], [2.0, 0.0, 1.0]);
}

#[test]
fn a_picked_strand_keeps_all_it_was_trained_with() {
    let whole = model();
    let order = [2, 1, 1, 0, 2];
    let picked = whole.pick(&order).unwrap();
    picked.validate().unwrap();
    assert_eq!(picked.guide_strands, [3, 0], "guides keep their numbers and lie at their first copy");
    for (at, &s) in order.iter().enumerate() {
        let s = s as usize;
        assert_eq!(picked.rest_of(at), whole.rest_of(s));
        assert_eq!(picked.eligible_of(at), whole.eligible_of(s));
        let (ours, theirs) = (picked.sets_of(at), whole.sets_of(s));
        assert_eq!(
            (ours.masks, ours.rms_error_cm, ours.stand_in),
            (theirs.masks, theirs.rms_error_cm, theirs.stand_in)
        );
        for set in 0..ours.masks.len() {
            let [a, b] = [(&picked, at), (&whole, s)]
                .map(|(m, strand)| m.weights_of_set(m.set_start[strand] as usize + set).collect::<Vec<_>>());
            assert_eq!(a, b);
        }
    }
    let all: Vec<u32> = (0..whole.n_strands).collect();
    assert_eq!(whole.pick(&all).unwrap(), whole);
}

#[test]
fn a_pick_without_a_guide_or_of_no_strand_is_refused() {
    let missing = model().pick(&[0, 1]).unwrap_err().to_string();
    assert!(missing.contains("guide 1 is strand 2"), "{missing}");
    let unknown = model().pick(&[0, 1, 2, 3]).unwrap_err().to_string();
    assert!(unknown.contains("strand 3 of 3"), "{unknown}");
}

#[test]
fn a_weight_survives_half_precision_to_a_thousandth() {
    /// Half precision keeps eleven bits.
    const HALF_ROUND_OFF: f32 = 5e-4;
    let poly = WeightPoly { quad: 0.37, lin: -0.81, con: 0.613 };
    let back = WeightPoly::from_bits(poly.to_bits());
    assert!((back.quad - poly.quad).abs() < HALF_ROUND_OFF && (back.lin - poly.lin).abs() < HALF_ROUND_OFF);
    assert!((poly.at(0.5) - (0.37 * 0.25 - 0.81 * 0.5 + 0.613)).abs() < HALF_ROUND_OFF);
}

#[test]
fn every_broken_invariant_of_a_model_is_refused_by_field() {
    type Break = fn(&mut SkinningModel);
    let breaks: [(&str, Break); 39] = [
        ("n_strands", |m| m.n_strands = 0),
        ("n_strands", |m| m.n_particles = 1),
        ("groom_in_head", |m| m.n_particles = u32::MAX),
        ("rest_in_head", |m| m.n_strands = 4),
        ("groom_in_head", |m| m.groom_in_head[4] = f32::NAN),
        ("groom_in_head", |m| m.groom_in_head.truncate(5)),
        ("rest_in_head", |m| m.rest_in_head[0] = f32::INFINITY),
        ("guide_strands", |m| m.guide_strands[1] = 0),
        ("guide_strands", |m| m.guide_strands[1] = 3),
        ("guide_strands", |m| m.guide_strands.clear()),
        ("eligible_start", |m| m.eligible_start[1] = 4),
        ("eligible_start", |m| m.eligible_start[0] = 1),
        ("eligible_start", |m| m.eligible_start[3] = u32::MAX),
        ("eligible_start", |m| m.eligible_start.clear()),
        ("eligible", |m| m.eligible_start[1] = 0),
        ("eligible", |m| m.eligible.swap(1, 2)),
        ("eligible", |m| m.eligible[4] = 2),
        ("set_start", |m| m.set_start[2] = 0),
        ("set_mask", |m| m.set_start[1] = 0),
        ("set_mask", |m| m.set_mask[1] = 0),
        ("set_mask", |m| m.set_mask[3] = 4),
        ("set_mask", |m| m.set_mask[2] = 1),
        ("set_rms_error_cm", |m| m.set_rms_error_cm[0] = f32::NAN),
        ("coeff_start", |m| m.coeff_start[5] = 7),
        ("coeff_start", |m| m.coeff_start[5] = u32::MAX),
        ("coeff_start", |m| m.coeff_start.truncate(5)),
        ("coeffs", |m| m.coeffs[0] = [0x7C00; 3]),
        ("coeffs", |m| m.coeffs[0] = [0; 3]),
        ("coeffs", |m| m.coeffs[3] = WeightPoly { quad: 3.0, lin: 0.0, con: 0.5 }.to_bits()),
        ("coeffs", |m| m.coeffs.push([0; 3])),
        ("stand_in", |m| m.stand_in[4] = 1),
        ("stand_in", |m| m.stand_in[6] = 2),
        ("stand_in", |m| m.stand_in_start[1] = 0),
        ("pairs", |m| m.pairs[0] = [1, 1]),
        ("pairs", |m| m.pairs[0] = [0, 2]),
        ("position_scale", |m| m.position_scale[0] = f32::NAN),
        ("velocity_scale", |m| m.velocity_scale.clear()),
        ("release_distance", |m| m.release_distance = 7.0),
        ("material", |m| m.material.linear_density_g_per_cm = 0.0),
    ];
    model().validate().unwrap();
    for (i, (field, break_it)) in breaks.into_iter().enumerate() {
        let mut broken = model();
        break_it(&mut broken);
        match broken.validate() {
            Err(Error::BadModel { field: found, .. }) => assert_eq!(found, field, "case {i}"),
            other => panic!("case {i}, {field}: {other:?}"),
        }
        let folder = folder();
        assert!(broken.save(&folder.path().join("never")).is_err());
    }
}

#[test]
fn a_hostile_payload_is_refused_and_never_panics() {
    let folder = folder();
    let path = folder.path().join("a.model");
    model().save(&path).unwrap();
    let payload = envelope::read(&path, Kind::SKINNING_MODEL, skinning_model::VERSION).unwrap();
    // The checksum is right in all of these: only decoding and validation stand between them and the runtime.
    let load = |bytes: &[u8]| {
        envelope::write(&path, Kind::SKINNING_MODEL, skinning_model::VERSION, bytes).unwrap();
        SkinningModel::load(&path)
    };
    for n in 0..payload.len() {
        assert!(load(&payload[..n]).is_err(), "{n} bytes");
    }
    assert!(load(&[payload.as_slice(), &[0]].concat()).unwrap_err().to_string().contains("left over"));
    for i in 0..payload.len() {
        for value in [0, 0xFF] {
            let mut b = payload.clone();
            b[i] = value;
            if let Ok(changed) = load(&b) {
                for strand in 0..changed.n_strands as usize {
                    let sets = changed.sets_of(strand);
                    let first = changed.set_start[strand] as usize;
                    for s in 0..sets.masks.len() {
                        assert!(changed.weights_of_set(first + s).all(|w| w.at(0.5).is_finite()));
                    }
                    let _ = changed.rest_of(strand);
                }
            }
        }
    }
}

/// Reads a model's file as docs/MODEL_FORMAT.md lays it out, with nothing of the library.
struct ByTheBook<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl ByTheBook<'_> {
    fn number<const B: usize>(&mut self) -> [u8; B] {
        self.at += B;
        self.bytes[self.at - B..self.at].try_into().unwrap()
    }

    fn array<const B: usize>(&mut self) -> Vec<[u8; B]> {
        let n = u64::from_le_bytes(self.number()) as usize;
        let entries = (0..n).map(|_| self.number()).collect();
        self.at = self.at.next_multiple_of(8);
        entries
    }
}

#[test]
fn the_bytes_of_a_model_are_those_of_the_document() {
    let folder = folder();
    let path = folder.path().join("a.model");
    let model = model();
    model.save(&path).unwrap();
    let file = std::fs::read(&path).unwrap();
    assert_eq!((&file[..8], &file[8..12], &file[12..16]), (&b"HAIRSKIN"[..], &b"SKIN"[..], &2_u32.to_le_bytes()[..]));
    assert_eq!(u64::from_le_bytes(file[16..24].try_into().unwrap()), file.len() as u64 - 32);
    let mut book = ByTheBook { bytes: &file[32..], at: 0 };
    let f32s = |entries: Vec<[u8; 4]>| entries.into_iter().map(f32::from_le_bytes).collect::<Vec<_>>();
    let u32s = |entries: Vec<[u8; 4]>| entries.into_iter().map(u32::from_le_bytes).collect::<Vec<_>>();
    let u16s = |entries: Vec<[u8; 2]>| entries.into_iter().map(u16::from_le_bytes).collect::<Vec<_>>();
    assert_eq!(u64::from_le_bytes(book.number()), model.provenance);
    assert_eq!(u32::from_le_bytes(book.number()), model.n_strands);
    assert_eq!(u32::from_le_bytes(book.number()), model.n_particles);
    assert_eq!(f32::from_le_bytes(book.number()), model.velocity_weight);
    assert_eq!(f32::from_le_bytes(book.number()), model.max_distance);
    assert_eq!(f32::from_le_bytes(book.number()), model.release_distance);
    assert_eq!(u32::from_le_bytes(book.number()), u32::from(model.blend == Blend::Rigid));
    assert_eq!(f64::from_le_bytes(book.number()), model.material.stretch_dyn);
    book.at += 7 * 8;
    assert_eq!(f64::from_le_bytes(book.number()), model.material.air_drag_per_s);
    assert_eq!(book.at, 104);
    assert_eq!(f32s(book.array()), model.groom_in_head);
    assert_eq!(f32s(book.array()), model.rest_in_head);
    assert_eq!(u32s(book.array()), model.guide_strands);
    assert_eq!(u32s(book.array()), model.eligible_start);
    assert_eq!(u16s(book.array()), model.eligible);
    assert_eq!(u32s(book.array()), model.set_start);
    assert_eq!(u16s(book.array()), model.set_mask);
    assert_eq!(f32s(book.array()), model.set_rms_error_cm);
    let halves = |b: [u8; 6]| [0, 2, 4].map(|at| u16::from_le_bytes([b[at], b[at + 1]]));
    assert_eq!(book.array().into_iter().map(halves).collect::<Vec<_>>(), model.coeffs);
    assert_eq!(u32s(book.array()), model.stand_in_start);
    assert_eq!(u16s(book.array()), model.stand_in);
    let pair = |b: [u8; 4]| [0, 2].map(|at| u16::from_le_bytes([b[at], b[at + 1]]));
    assert_eq!(book.array().into_iter().map(pair).collect::<Vec<_>>(), model.pairs);
    assert_eq!(f32s(book.array()), model.position_scale);
    assert_eq!(f32s(book.array()), model.velocity_scale);
    assert_eq!(book.at, book.bytes.len());
}

#[test]
fn a_model_of_the_first_version_is_refused_with_what_to_do() {
    let folder = folder();
    let path = folder.path().join("old.model");
    envelope::write(&path, Kind::SKINNING_MODEL, 1, b"anything").unwrap();
    let said = SkinningModel::load(&path).unwrap_err().to_string();
    assert!(said.contains("version 2") && said.contains("training"), "{said}");
}
