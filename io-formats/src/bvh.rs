//! BVH motion capture: a joint hierarchy and one row of channel values per frame.
//!
//! Reads what occurs in real files: CRLF, e-notation, three- and six-channel joints, any rotation order, names with colons
//! or spaces. Rotations apply in channel order, intrinsically. Position channels replace the joint's offset: files whose
//! every joint has six channels repeat the offset in them. Lengths stay in the file's unit, which the file does not state.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::bytes::read_file;
use crate::error::{Error, Result};

/// Largest number of joints read; real skeletons have below 200.
const MAX_JOINTS: usize = 10_000;

/// A turn faster than this (degrees a second) between the first two frames betrays an added T-pose.
pub const T_POSE_JUMP_DEG_PER_S: f64 = 2000.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Channel {
    Position(usize),
    Rotation(usize),
}

#[derive(Debug, Clone)]
struct Joint {
    name: String,
    parent: Option<usize>,
    offset: Vector3<f64>,
    channels: Vec<Channel>,
    first_channel: usize,
}

/// A parsed motion.
#[derive(Debug, Clone)]
pub struct Bvh {
    path: PathBuf,
    joints: Vec<Joint>,
    frame_time: f64,
    n_frames: usize,
    n_channels: usize,
    /// `n_frames * n_channels` values, frame after frame; lengths in the file's unit, angles in degrees.
    values: Vec<f64>,
}

impl Bvh {
    /// Reads a BVH file.
    ///
    /// # Errors
    /// When the file cannot be read, or a line cannot be understood.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(path, &read_file(path)?)
    }

    /// [`Bvh::read`] from bytes; `path` serves the error texts.
    ///
    /// # Errors
    /// As [`Bvh::read`].
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let text = std::str::from_utf8(bytes).map_err(|e| Error::BadField {
            path: path.to_path_buf(),
            field: "text",
            offset: e.valid_up_to() as u64,
            reason: "not UTF-8".into(),
        })?;
        // Some exporters on Windows write a byte-order mark.
        let text = text.trim_start_matches('\u{feff}');
        let mut lines = Lines { path, lines: text.lines(), line: 0 };
        let joints = parse_hierarchy(&mut lines)?;
        let n_channels: usize = joints.iter().map(|j| j.channels.len()).sum();

        let words = lines.expect("Frames:")?;
        let n_frames = match words.as_slice() {
            ["Frames:", n] => n.parse::<usize>().map_err(|_| lines.bad(format!("bad frame count {n:?}")))?,
            _ => return Err(lines.bad(format!("expected \"Frames: <count>\", found {:?}", words.join(" ")))),
        };
        let words = lines.expect("Frame Time:")?;
        let frame_time = match words.as_slice() {
            ["Frame", "Time:", s] => number(&lines, s)?,
            _ => return Err(lines.bad(format!("expected \"Frame Time: <seconds>\", found {:?}", words.join(" ")))),
        };
        if frame_time <= 0.0 {
            return Err(lines.bad(format!("frame time {frame_time} s is not positive")));
        }
        if n_frames == 0 || n_channels == 0 {
            return Err(lines.bad(format!("{n_frames} frames of {n_channels} channels hold no motion")));
        }
        // A value takes at least two bytes of text, which bounds the allocation by the file's length.
        let needed = n_frames.saturating_mul(n_channels);
        if needed > bytes.len().div_ceil(2) {
            let why = format!("{n_frames} frames of {n_channels} channels do not fit in {} bytes", bytes.len());
            return Err(lines.bad(why));
        }
        let mut values = Vec::with_capacity(needed);
        while values.len() < needed {
            let frame = values.len() / n_channels;
            let before = values.len();
            for word in lines.expect("channel values")? {
                values.push(number(&lines, word)?);
            }
            if values.len() - before != n_channels {
                let why = format!("frame {frame} has {} values, {n_channels} are needed", values.len() - before);
                return Err(lines.bad(why));
            }
        }
        Ok(Self { path: path.to_path_buf(), joints, frame_time, n_frames, n_channels, values })
    }

    /// Number of frames.
    #[must_use]
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Seconds from one frame to the next.
    #[must_use]
    pub fn frame_time(&self) -> f64 {
        self.frame_time
    }

    /// Number of joints, end sites not counted.
    #[must_use]
    pub fn n_joints(&self) -> usize {
        self.joints.len()
    }

    /// Joint names in file order.
    pub fn joint_names(&self) -> impl Iterator<Item = &str> {
        self.joints.iter().map(|j| j.name.as_str())
    }

    /// Index of the joint of this name.
    ///
    /// # Errors
    /// [`Error::UnknownJoint`] with all names.
    pub fn joint_index(&self, name: &str) -> Result<usize> {
        self.joints.iter().position(|j| j.name == name).ok_or_else(|| Error::UnknownJoint {
            path: self.path.clone(),
            name: name.to_owned(),
            known: self.joint_names().collect::<Vec<_>>().join(", "),
        })
    }

    /// Pose of a joint in the file's world, lengths in the file's unit.
    ///
    /// # Panics
    /// If there is no such frame or joint.
    #[must_use]
    pub fn world_pose(&self, frame: usize, joint: usize) -> Isometry3<f64> {
        let values = &self.values[frame * self.n_channels..(frame + 1) * self.n_channels];
        let mut pose = self.joints[joint].local_pose(values);
        let mut parent = self.joints[joint].parent;
        while let Some(p) = parent {
            pose = self.joints[p].local_pose(values) * pose;
            parent = self.joints[p].parent;
        }
        pose
    }

    /// Speed (degrees a second) at which a joint turns between frames 0 and 1. Above [`T_POSE_JUMP_DEG_PER_S`] frame 0 is
    /// an added T-pose and should be skipped. 0 with a single frame.
    ///
    /// # Panics
    /// If there is no such joint.
    #[must_use]
    pub fn initial_jump_deg_per_s(&self, joint: usize) -> f64 {
        if self.n_frames < 2 {
            return 0.0;
        }
        let (a, b) = (self.world_pose(0, joint), self.world_pose(1, joint));
        a.rotation.angle_to(&b.rotation).to_degrees() / self.frame_time
    }
}

impl Joint {
    fn local_pose(&self, values: &[f64]) -> Isometry3<f64> {
        let mut translation = self.offset;
        let mut rotation = UnitQuaternion::identity();
        for (channel, &value) in self.channels.iter().zip(&values[self.first_channel..]) {
            match *channel {
                Channel::Position(axis) => translation[axis] = value,
                Channel::Rotation(axis) => {
                    let unit = Vector3::ith_axis(axis);
                    rotation *= UnitQuaternion::from_axis_angle(&unit, value.to_radians());
                }
            }
        }
        Isometry3::from_parts(Translation3::from(translation), rotation)
    }
}

/// The hierarchy, without recursion: depth comes from the file.
fn parse_hierarchy(lines: &mut Lines<'_>) -> Result<Vec<Joint>> {
    /// What an open brace belongs to.
    enum Block {
        Joint(usize),
        EndSite,
    }
    let words = lines.expect("HIERARCHY")?;
    if words != ["HIERARCHY"] {
        return Err(lines.bad(format!("expected \"HIERARCHY\", found {:?}", words.join(" "))));
    }
    let mut joints: Vec<Joint> = Vec::new();
    let mut open: Vec<Block> = Vec::new();
    let mut n_channels = 0;
    loop {
        let mut words = lines.expect("the hierarchy, or MOTION")?;
        // Some writers put the brace at the end of the line.
        let opens_here = words.len() > 1 && words.last() == Some(&"{");
        if opens_here {
            words.pop();
        }
        match words.as_slice() {
            ["MOTION"] if open.is_empty() && !joints.is_empty() => return Ok(joints),
            [kind @ ("ROOT" | "JOINT"), name @ ..] if !name.is_empty() => {
                let parent = match open.last() {
                    None if *kind == "ROOT" => None,
                    Some(Block::Joint(p)) if *kind == "JOINT" => Some(*p),
                    _ => return Err(lines.bad(format!("{kind} is out of place"))),
                };
                if joints.len() == MAX_JOINTS {
                    return Err(lines.bad(format!("more than {MAX_JOINTS} joints")));
                }
                let name = name.join(" ");
                joints.push(Joint {
                    name,
                    parent,
                    offset: Vector3::zeros(),
                    channels: Vec::new(),
                    first_channel: n_channels,
                });
                open.push(Block::Joint(joints.len() - 1));
                if !opens_here {
                    lines.expect_brace()?;
                }
            }
            ["End", "Site"] => {
                open.push(Block::EndSite);
                if !opens_here {
                    lines.expect_brace()?;
                }
            }
            ["OFFSET", x, y, z] => {
                let offset = Vector3::new(number(lines, x)?, number(lines, y)?, number(lines, z)?);
                match open.last() {
                    Some(Block::Joint(j)) => joints[*j].offset = offset,
                    Some(Block::EndSite) => {}
                    None => return Err(lines.bad("OFFSET is out of place".into())),
                }
            }
            ["CHANNELS", count, names @ ..] => {
                let Some(Block::Joint(j)) = open.last() else {
                    return Err(lines.bad("CHANNELS is out of place".into()));
                };
                // Channel values follow in file order, so a second list, or one after a child, would shift all others.
                if !joints[*j].channels.is_empty() || *j + 1 != joints.len() {
                    return Err(lines.bad("CHANNELS must come once, before the joint's children".into()));
                }
                if count.parse() != Ok(names.len()) || names.len() > 6 {
                    return Err(lines.bad(format!("{count} channels announced, {} named", names.len())));
                }
                let channels = names.iter().map(|n| channel(lines, n)).collect::<Result<Vec<_>>>()?;
                n_channels += channels.len();
                joints[*j].channels = channels;
            }
            ["}"] => {
                if open.pop().is_none() {
                    return Err(lines.bad("a closing brace without an opening one".into()));
                }
            }
            _ => return Err(lines.bad(format!("cannot understand {:?}", words.join(" ")))),
        }
    }
}

fn channel(lines: &Lines<'_>, name: &str) -> Result<Channel> {
    let lower = name.to_ascii_lowercase();
    let axis = match lower.as_bytes().first() {
        Some(b'x') => 0,
        Some(b'y') => 1,
        Some(b'z') => 2,
        _ => return Err(lines.bad(format!("unknown channel {name:?}"))),
    };
    match &lower[1..] {
        "position" => Ok(Channel::Position(axis)),
        "rotation" => Ok(Channel::Rotation(axis)),
        _ => Err(lines.bad(format!("unknown channel {name:?}"))),
    }
}

fn number(lines: &Lines<'_>, word: &str) -> Result<f64> {
    match word.parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err(lines.bad(format!("{word:?} is not a finite number"))),
    }
}

/// Lines that are not blank, with their number.
struct Lines<'a> {
    path: &'a Path,
    lines: std::str::Lines<'a>,
    line: usize,
}

impl<'a> Lines<'a> {
    /// The words of the next line that has any.
    fn expect(&mut self, what: &str) -> Result<Vec<&'a str>> {
        for text in self.lines.by_ref() {
            self.line += 1;
            let words: Vec<_> = text.split_whitespace().collect();
            if !words.is_empty() {
                return Ok(words);
            }
        }
        Err(self.bad(format!("the file ends where {what} should follow")))
    }

    fn expect_brace(&mut self) -> Result<()> {
        let words = self.expect("an opening brace")?;
        if words == ["{"] { Ok(()) } else { Err(self.bad(format!("expected \"{{\", found {:?}", words.join(" ")))) }
    }

    fn bad(&self, reason: String) -> Error {
        Error::BadLine { path: self.path.to_path_buf(), line: self.line, reason }
    }
}
