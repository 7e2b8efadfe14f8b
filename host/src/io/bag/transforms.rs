//! Frames and their motion: a forest in which every frame has at most one parent.
//!
//! The pose of a frame in its parent is linear in the translation and spherically linear
//! in the rotation between two stamps. Beyond the first and last stamp it holds for
//! [`HOLD_NS`]; later there is none.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::collections::BTreeMap;

/// How long the first and the last pose are good for \[ns\].
const HOLD_NS: i64 = 200_000_000;
/// Frames that may stand for the ground where no transform leads from them.
const FIXED: [&str; 4] = ["map", "odom", "world", "earth"];

/// Poses of one frame in its parent.
struct Edge {
    parent: String,
    /// stamped poses; one without a stamp holds for ever
    poses: Vec<(Option<i64>, Isometry3<f64>)>,
}

/// All transforms of a bag.
#[derive(Default)]
pub(super) struct Transforms {
    edges: BTreeMap<String, Edge>,
    odometry: BTreeMap<String, Edge>,
}

/// The edges from a frame to the fixed one.
pub(super) struct Way<'a>(Vec<&'a Edge>);

/// From a translation \[m\] and a quaternion x, y, z, w.
pub(super) fn isometry(t: &[f64; 3], q: &[f64; 4]) -> Result<Isometry3<f64>, String> {
    let rotation = Quaternion::new(q[3], q[0], q[1], q[2]);
    let sound = t.iter().chain(q).all(|v| v.is_finite());
    if !sound || (rotation.norm() - 1.0).abs() > 0.01 {
        return Err("a pose that is not finite or whose quaternion is not a unit".into());
    }
    Ok(Isometry3::from_parts(
        Translation3::new(t[0], t[1], t[2]),
        UnitQuaternion::from_quaternion(rotation),
    ))
}

impl Transforms {
    /// A transform; without a stamp a static one.
    pub(super) fn add(&mut self, parent: &str, child: &str, at: Option<i64>, pose: Isometry3<f64>) {
        add(&mut self.edges, parent, child, at, pose);
    }

    /// A pose of odometry, used where no transform leads from `child`.
    pub(super) fn add_odometry(
        &mut self,
        parent: &str,
        child: &str,
        at: i64,
        pose: Isometry3<f64>,
    ) {
        add(&mut self.odometry, parent, child, Some(at), pose);
    }

    /// The way from `frame` up to a frame without a parent. A frame from which nothing
    /// leads is taken as fixed if it is called so, or if `alone` (a single cloud) says
    /// that it does not matter.
    pub(super) fn way(&self, frame: &str, alone: bool) -> Result<Way<'_>, String> {
        let (mut way, mut at) = (Vec::new(), frame);
        while let Some(edge) = self.edges.get(at).or_else(|| self.odometry.get(at)) {
            way.push(edge);
            at = &edge.parent;
            if way.len() > self.edges.len() + self.odometry.len() {
                return Err(format!(
                    "the transforms from '{frame}' go round in a circle"
                ));
            }
        }
        if way.is_empty() && !alone && !FIXED.contains(&at) {
            return Err(format!(
                "no transform leads from the clouds' frame '{frame}', and no odometry: where they were seen from is unknown"
            ));
        }
        Ok(Way(way))
    }
}

fn add(
    edges: &mut BTreeMap<String, Edge>,
    parent: &str,
    child: &str,
    at: Option<i64>,
    pose: Isometry3<f64>,
) {
    let [parent, child] = [parent, child].map(|f| f.trim_start_matches('/').to_owned());
    let edge = edges.entry(child).or_insert_with(|| Edge {
        parent: parent.clone(),
        poses: Vec::new(),
    });
    edge.parent = parent;
    // several nodes may publish transforms, so their order in the bag is not that of time
    let place = edge.poses.partition_point(|p| p.0 <= at);
    edge.poses.insert(place, (at, pose));
}

impl Way<'_> {
    /// fixed ← frame at a time.
    pub(super) fn at(&self, stamp_ns: i64) -> Option<Isometry3<f64>> {
        let mut pose = Isometry3::identity();
        for edge in &self.0 {
            pose = edge.at(stamp_ns)? * pose;
        }
        Some(pose)
    }
}

impl Edge {
    fn at(&self, stamp_ns: i64) -> Option<Isometry3<f64>> {
        let next = self
            .poses
            .partition_point(|p| p.0.is_none_or(|at| at <= stamp_ns));
        let before = next.checked_sub(1).map(|i| &self.poses[i]);
        match (before, self.poses.get(next)) {
            (Some((None, pose)), None) => Some(*pose),
            (Some((Some(t0), a)), Some((Some(t1), b))) => {
                let part = (stamp_ns - t0) as f64 / (t1 - t0) as f64;
                Some(a.lerp_slerp(b, part))
            }
            (Some((Some(t), pose)), None) => (stamp_ns - t <= HOLD_NS).then_some(*pose),
            (_, Some((Some(t), pose))) => (t - stamp_ns <= HOLD_NS).then_some(*pose),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(x: f64, yaw: f64) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
        Isometry3::from_parts(Translation3::new(x, 0.0, 0.0), rotation)
    }

    #[test]
    fn poses_are_interpolated_and_chained() {
        let mut transforms = Transforms::default();
        transforms.add("base", "lidar", None, Isometry3::translation(0.0, 0.0, 1.0));
        transforms.add("odom", "base", Some(2_000_000_000), turned(4.0, 1.0));
        transforms.add("odom", "base", Some(0), turned(0.0, 0.0));
        transforms.add_odometry("elsewhere", "base", 0, turned(9.0, 9.0));
        let way = transforms.way("lidar", false).unwrap();
        let pose = way.at(500_000_000).unwrap();
        assert!((pose.translation.vector - nalgebra::Vector3::new(1.0, 0.0, 1.0)).norm() < 1e-12);
        assert!((pose.rotation.euler_angles().2 - 0.25).abs() < 1e-12);
        assert!(way.at(2_100_000_000).is_some() && way.at(2_300_000_000).is_none());
        assert!(way.at(-100_000_000).is_some() && way.at(-300_000_000).is_none());
    }

    #[test]
    fn a_frame_without_a_way_is_named() {
        let mut transforms = Transforms::default();
        assert!(transforms.way("map", false).is_ok() && transforms.way("lidar", true).is_ok());
        let error = transforms.way("lidar", false).err().unwrap();
        assert!(error.contains("'lidar'"), "{error}");
        transforms.add("a", "b", None, Isometry3::identity());
        transforms.add("b", "a", None, Isometry3::identity());
        assert!(transforms.way("a", false).err().unwrap().contains("circle"));
        assert!(isometry(&[0.0; 3], &[0.0; 4]).is_err());
    }
}
