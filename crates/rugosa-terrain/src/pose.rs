//! The pose at the instant of a return.
//!
//! A ring of the last [`POSES`] stamped poses. Between two of them the position is
//! interpolated linearly and the orientation by the normalised linear interpolation of
//! quaternions (nlerp): products, sums and one square root, so that all platforms agree
//! to the bit. Slerp would need sin and acos. The price: with a turn of φ between two
//! poses, nlerp is behind or ahead of an even turn by at most φ³/125 (10°: 0.0025°, 45°: 0.22°,
//! `nlerp_stays_close_to_an_even_turn`).
//!
//! Nothing is extrapolated. A stamp before the first pose, after the last, or in a gap
//! longer than [`PoseBuffer::gap_us`] has no pose, and the answer says which it was. A
//! robot that stands still and sends one pose sets [`PoseBuffer::hold_us`]: for so long
//! the last pose stays valid.
//!
//! Cost: the search starts at the newest pose; about 150 operations per call. Memory:
//! 40 bytes per pose.

use heapless::Deque;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use rugosa_grid::math;

/// Poses that are kept.
pub const POSES: usize = 32;

/// Why there is no pose at a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPose {
    /// no pose has arrived yet
    Empty,
    /// older than the oldest pose that is kept
    BeforeFirst,
    /// newer than the last pose (plus the hold time)
    AfterLast,
    /// between two poses that are too far apart in time
    Gap,
}

/// Why a pose was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseError {
    /// its stamp is not after the last one: time runs backwards
    Backwards,
    /// a number is not finite, or the quaternion is far from unit length
    Invalid,
}

#[derive(Clone, Copy, Debug)]
struct Stamped {
    stamp_us: u64,
    pose: Isometry3<f32>,
}

/// The last poses, by time stamp.
///
/// ```
/// use nalgebra::Isometry3;
/// use rugosa_terrain::{NoPose, PoseBuffer, PoseError};
/// let mut poses = PoseBuffer::new();
/// assert_eq!(poses.at(0).unwrap_err(), NoPose::Empty);
/// poses.push(1_000_000, &Isometry3::translation(0.0, 0.0, 0.0)).unwrap();
/// let two_metres_on = Isometry3::translation(2.0, 0.0, 0.0);
/// poses.push(2_000_000, &two_metres_on).unwrap();
/// assert_eq!(poses.at(1_250_000).unwrap().translation.x, 0.5); // metres
/// assert_eq!(poses.at(2_100_000).unwrap_err(), NoPose::AfterLast);
/// poses.hold_us = 200_000; // the robot stands still
/// assert_eq!(poses.at(2_100_000).unwrap().translation.x, 2.0);
/// assert_eq!(poses.push(1_500_000, &two_metres_on), Err(PoseError::Backwards));
/// ```
#[derive(Clone, Debug, Default)]
pub struct PoseBuffer {
    ring: Deque<Stamped, POSES>,
    /// how long the last pose stays valid \[µs\], 0 at first
    pub hold_us: u64,
    /// longest time between two poses that is interpolated \[µs\]; 0 stands for any
    pub gap_us: u64,
    /// poses refused because time ran backwards
    pub backwards: u32,
    /// poses refused because they were no poses
    pub invalid: u32,
}

impl PoseBuffer {
    /// An empty buffer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Poses at hand.
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// None at all?
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    /// The last pose and its stamp.
    pub fn last(&self) -> Option<(u64, Isometry3<f32>)> {
        self.ring.back().map(|s| (s.stamp_us, s.pose))
    }

    /// Forgets all poses (not the counters): the scanner's clock has started afresh.
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa_terrain::PoseBuffer;
    /// let mut poses = PoseBuffer::new();
    /// poses.push(9_000_000, &Isometry3::identity()).unwrap();
    /// assert!(poses.push(20, &Isometry3::identity()).is_err()); // the clock started afresh
    /// poses.clear();
    /// poses.push(20, &Isometry3::identity()).unwrap();
    /// assert_eq!((poses.last().unwrap().0, poses.backwards), (20, 1));
    /// ```
    pub fn clear(&mut self) {
        self.ring.clear();
    }

    /// Takes a pose; the oldest gives way when the ring is full. What is refused is
    /// counted. The quaternion is normalised again.
    pub fn push(&mut self, stamp_us: u64, pose: &Isometry3<f32>) -> Result<(), PoseError> {
        let Some(pose) = sound(pose) else {
            self.invalid += 1;
            return Err(PoseError::Invalid);
        };
        if self
            .ring
            .back()
            .is_some_and(|last| stamp_us <= last.stamp_us)
        {
            self.backwards += 1;
            return Err(PoseError::Backwards);
        }
        if self.ring.is_full() {
            self.ring.pop_front();
        }
        let pushed = self.ring.push_back(Stamped { stamp_us, pose });
        debug_assert!(pushed.is_ok());
        Ok(())
    }

    /// The pose at a stamp.
    ///
    /// ```
    /// use nalgebra::{Isometry3, Vector3};
    /// use rugosa_terrain::{NoPose, PoseBuffer};
    /// let yaw = |angle: f32| Isometry3::rotation(Vector3::z() * angle);
    /// let mut poses = PoseBuffer::new();
    /// poses.gap_us = 500_000;
    /// poses.push(0, &yaw(0.0)).unwrap();
    /// poses.push(100_000, &yaw(0.2)).unwrap();
    /// poses.push(900_000, &yaw(0.4)).unwrap();
    /// let (_, _, angle) = poses.at(50_000).unwrap().rotation.euler_angles();
    /// assert!((angle - 0.1).abs() < 1e-5); // rad to the left
    /// assert_eq!(poses.at(500_000).unwrap_err(), NoPose::Gap);
    /// ```
    pub fn at(&self, stamp_us: u64) -> Result<Isometry3<f32>, NoPose> {
        let last = self.ring.back().ok_or(NoPose::Empty)?;
        if stamp_us > last.stamp_us.saturating_add(self.hold_us) {
            return Err(NoPose::AfterLast);
        }
        let mut later = last;
        for earlier in self.ring.iter().rev() {
            if stamp_us >= earlier.stamp_us {
                return self.between(earlier, later, stamp_us);
            }
            later = earlier;
        }
        Err(NoPose::BeforeFirst)
    }

    fn between(&self, a: &Stamped, b: &Stamped, stamp_us: u64) -> Result<Isometry3<f32>, NoPose> {
        if stamp_us == a.stamp_us || a.stamp_us == b.stamp_us {
            return Ok(a.pose);
        }
        let gap = b.stamp_us - a.stamp_us;
        if self.gap_us != 0 && gap > self.gap_us {
            return Err(NoPose::Gap);
        }
        Ok(blend(
            &a.pose,
            &b.pose,
            (stamp_us - a.stamp_us) as f32 / gap as f32,
        ))
    }
}

/// The pose a part `t` of the way from `a` to `b`.
fn blend(a: &Isometry3<f32>, b: &Isometry3<f32>, t: f32) -> Isometry3<f32> {
    let (from, to) = (a.rotation.coords, b.rotation.coords);
    let to = if from.dot(&to) < 0.0 { -to } else { to };
    let along = |a: f32, b: f32| a + t * (b - a);
    let position = a.translation.vector.zip_map(&b.translation.vector, along);
    let rotation = from.zip_map(&to, along);
    Isometry3::from_parts(
        Translation3::from(position),
        unit(Quaternion::from(rotation)),
    )
}

fn unit(q: Quaternion<f32>) -> UnitQuaternion<f32> {
    let scale = 1.0 / math::sqrt(q.coords.dot(&q.coords));
    UnitQuaternion::new_unchecked(q * scale)
}

/// The pose with its quaternion normalised, if it is one: finite, and the quaternion's
/// length within 1 % of 1.
fn sound(pose: &Isometry3<f32>) -> Option<Isometry3<f32>> {
    let position = pose.translation.vector;
    let q = pose.rotation.into_inner();
    let length2 = q.coords.dot(&q.coords);
    let good = position.iter().all(|x| x.is_finite()) && math::abs(length2 - 1.0) < 0.02;
    good.then(|| Isometry3::from_parts(pose.translation, unit(q)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn turned(x: f32, yaw: f32) -> Isometry3<f32> {
        Isometry3::new(Vector3::new(x, -2.0 * x, 0.5), Vector3::new(0.0, 0.0, yaw))
    }

    #[test]
    fn each_cause_is_told_apart() {
        let mut poses = PoseBuffer::new();
        assert_eq!(poses.at(5), Err(NoPose::Empty));
        poses.push(1000, &turned(1.0, 0.0)).unwrap();
        assert_eq!(poses.at(999), Err(NoPose::BeforeFirst));
        assert_eq!(poses.at(1000).unwrap(), turned(1.0, 0.0));
        assert_eq!(poses.at(1001), Err(NoPose::AfterLast));
        poses.push(3000, &turned(2.0, 0.0)).unwrap();
        assert!(poses.at(3000).is_ok() && poses.at(3001).is_err());
        poses.gap_us = 1999;
        assert_eq!(poses.at(2000), Err(NoPose::Gap));
        assert!(poses.at(1000).is_ok() && poses.at(3000).is_ok());
        poses.hold_us = 10;
        assert_eq!(poses.at(3010).unwrap(), turned(2.0, 0.0));
        assert_eq!(poses.at(3011), Err(NoPose::AfterLast));
        assert_eq!(poses.at(u64::MAX), Err(NoPose::AfterLast));
        poses.hold_us = u64::MAX;
        assert!(poses.at(u64::MAX).is_ok());
    }

    #[test]
    fn what_is_refused_is_counted_and_changes_nothing() {
        let mut poses = PoseBuffer::new();
        poses.push(10, &turned(1.0, 0.0)).unwrap();
        assert_eq!(poses.push(10, &turned(2.0, 0.0)), Err(PoseError::Backwards));
        assert_eq!(poses.push(9, &turned(2.0, 0.0)), Err(PoseError::Backwards));
        assert_eq!(
            poses.push(20, &turned(f32::NAN, 0.0)),
            Err(PoseError::Invalid)
        );
        let long = Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::new_unchecked(Quaternion::new(1.1, 0.0, 0.0, 0.0)),
        );
        assert_eq!(poses.push(20, &long), Err(PoseError::Invalid));
        assert_eq!((poses.backwards, poses.invalid, poses.len()), (2, 2, 1));
    }

    #[test]
    fn the_ring_keeps_the_newest() {
        let mut poses = PoseBuffer::new();
        for i in 0..100 {
            poses.push(i * 10, &turned(i as f32, 0.0)).unwrap();
        }
        assert_eq!(poses.len(), POSES);
        assert_eq!(poses.at(679), Err(NoPose::BeforeFirst));
        assert_eq!(poses.at(685).unwrap().translation.x, 68.5);
        assert_eq!(poses.last().unwrap().0, 990);
    }

    #[test]
    fn nlerp_stays_close_to_an_even_turn() {
        for degrees in [1.0f32, 10.0, 45.0, 90.0] {
            let turn = degrees.to_radians();
            let worst = (0..=100).fold(0.0f32, |worst, i| {
                let t = i as f32 / 100.0;
                let yaw = blend(&turned(0.0, 0.0), &turned(1.0, turn), t)
                    .rotation
                    .euler_angles()
                    .2;
                worst.max((yaw - t * turn).abs())
            });
            assert!(worst <= turn.powi(3) / 125.0 + 1e-6, "{degrees}: {worst}");
        }
    }

    proptest! {
        #[test]
        fn a_blend_is_a_pose_between_the_two(
            a in prop::array::uniform3(-3f32..3.0), b in prop::array::uniform3(-1f32..1.0),
            t in 0f32..1.0, flip: bool
        ) {
            let from = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::from(a));
            let turn = UnitQuaternion::new(Vector3::from(b));
            let mut to = Isometry3::from_parts(Translation3::new(5.0, 2.0, -1.0), turn * from.rotation);
            if flip {
                to.rotation = UnitQuaternion::new_unchecked(-to.rotation.into_inner());
            }
            let found = blend(&from, &to, t);
            let expected = from.rotation.slerp(&(turn * from.rotation), t);
            prop_assert!((found.rotation.norm() - 1.0).abs() < 1e-6);
            prop_assert!(found.rotation.angle_to(&expected) < turn.angle().powi(3) / 125.0 + 1e-3);
            prop_assert!((found.translation.x - (1.0 + 4.0 * t)).abs() < 1e-5);
            prop_assert!((found.translation.z - (3.0 - 4.0 * t)).abs() < 1e-5);
        }
    }
}
