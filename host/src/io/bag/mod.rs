//! ROS 2 bags (MCAP): the points of every `sensor_msgs/msg/PointCloud2`, in the frame
//! that the bag's transforms lead to.
//!
//! | file | what |
//! |---|---|
//! | `messages` | the messages as they are in CDR, as far as they are needed |
//! | `transforms` | frames, their motion, the way from a cloud's frame to the fixed one |
//!
//! The pose of a cloud comes from `tf2_msgs/msg/TFMessage` (`/tf`, `/tf_static`) and,
//! for frames that no transform leads from, `nav_msgs/msg/Odometry`; between two stamps
//! it is interpolated. A cloud counts with its stamp as a whole: points are not moved to
//! times of their own. Clouds without a pose are left out and their points counted.

mod messages;
mod transforms;

use super::Points;
use crate::error::{Failure, Result};
use mcap::sans_io::linear_reader::LinearReaderOptions;
use mcap::sans_io::message_reader::{MessageReadEvent, MessageReader};
use mcap::{Channel, McapError};
use messages::{Odometry, PointCloud2, TfMessage, decode};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use transforms::{Transforms, isometry};

/// Bytes that are read at a time.
const READ_BYTES: usize = 256 * 1024;
/// Longest record or chunk that is taken; a file that claims more is damaged.
const MAX_RECORD_BYTES: usize = 512 << 20;
/// Most points of a bag: what fits into 2.4 GB.
const MOST_POINTS: usize = 100_000_000;

/// One cloud as it came, to be placed once all transforms are known.
struct Cloud {
    frame: String,
    stamp_ns: i64,
    /// finite points in the frame of the cloud \[m\]
    xyz: Vec<[f32; 3]>,
}

/// What a bag holds, collected in one pass.
#[derive(Default)]
struct Collected {
    clouds: Vec<Cloud>,
    transforms: Transforms,
    points: usize,
    skipped: usize,
    /// stamp of the last message by topic \[ns\]
    last: BTreeMap<String, i64>,
    /// other kinds of messages
    others: BTreeMap<String, u64>,
}

/// Reads all points of the bag.
pub fn read(path: &Path) -> Result<Points> {
    let mut collected = Collected::default();
    each_message(path, |channel, data| collected.take(channel, data))?;
    if collected.clouds.is_empty() {
        return Err(Failure::file(path, collected.without_clouds()));
    }
    let (xyz, late) = collected.placed().map_err(|e| Failure::file(path, e))?;
    if xyz.is_empty() && late > 0 {
        let clouds = collected.clouds.len();
        let message = format_args!("none of the {clouds} clouds has a pose at its time");
        return Err(Failure::file(path, message));
    }
    let mut points = Points::of(path, xyz)?;
    points.skipped += collected.skipped + late;
    Ok(points)
}

impl Collected {
    /// What there is instead of clouds.
    fn without_clouds(&self) -> String {
        let kinds: Vec<&str> = self.others.keys().map(String::as_str).collect();
        let hint = match kinds.contains(&crate::recording::SCHEMA_NAME) {
            true => " (a recording of rugosa: use `rugosa replay`)",
            false => "",
        };
        let kinds = kinds.join(", ");
        format!("no sensor_msgs/msg/PointCloud2 in it, only: {kinds}{hint}")
    }

    /// The points in the fixed frame, and how many have no pose at their time.
    fn placed(&self) -> Result<(Vec<[f64; 3]>, usize), String> {
        let (mut xyz, mut late) = (Vec::with_capacity(self.points), 0);
        for cloud in &self.clouds {
            let way = self.transforms.way(&cloud.frame, self.clouds.len() == 1)?;
            let Some(pose) = way.at(cloud.stamp_ns) else {
                late += cloud.xyz.len();
                continue;
            };
            xyz.extend(cloud.xyz.iter().map(|p| {
                let moved = pose * nalgebra::Point3::from(p.map(f64::from));
                [moved.x, moved.y, moved.z]
            }));
        }
        Ok((xyz, late))
    }

    fn take(&mut self, channel: &Channel, data: &[u8]) -> Result<(), String> {
        let kind = channel.schema.as_ref().map_or("", |s| s.name.as_str());
        match kind {
            "sensor_msgs/msg/PointCloud2" => {
                let cloud: PointCloud2 = decode(data)?;
                self.in_order(&channel.topic, cloud.header.stamp.ns())?;
                self.cloud(&cloud)
            }
            "tf2_msgs/msg/TFMessage" => {
                let fixed = channel.topic.ends_with("tf_static");
                for t in decode::<TfMessage>(data)?.transforms {
                    let pose = isometry(&t.transform.translation, &t.transform.rotation)?;
                    let stamp = (!fixed).then(|| t.header.stamp.ns());
                    self.transforms
                        .add(&t.header.frame_id, &t.child_frame_id, stamp, pose);
                }
                Ok(())
            }
            "nav_msgs/msg/Odometry" => {
                let o: Odometry = decode(data)?;
                self.in_order(&channel.topic, o.header.stamp.ns())?;
                let pose = isometry(&o.position, &o.orientation)?;
                let stamp = o.header.stamp.ns();
                self.transforms
                    .add_odometry(&o.header.frame_id, &o.child_frame_id, stamp, pose);
                Ok(())
            }
            other => {
                *self.others.entry(other.into()).or_default() += 1;
                Ok(())
            }
        }
    }

    /// Time never goes backwards within a topic.
    fn in_order(&mut self, topic: &str, stamp_ns: i64) -> Result<(), String> {
        let last = self.last.entry(topic.into()).or_insert(stamp_ns);
        if stamp_ns < *last {
            let seconds = |ns: i64| ns as f64 * 1e-9;
            return Err(format!(
                "{topic}: time goes backwards, from {:.3} to {:.3} s",
                seconds(*last),
                seconds(stamp_ns)
            ));
        }
        *last = stamp_ns;
        Ok(())
    }

    fn cloud(&mut self, message: &PointCloud2) -> Result<(), String> {
        let all = message.points()?;
        let total = all.len();
        let xyz: Vec<_> = all
            .into_iter()
            .filter(|p| p.iter().all(|v| v.is_finite()))
            .collect();
        self.skipped += total - xyz.len();
        self.points += xyz.len();
        if self.points > MOST_POINTS {
            return Err(format!(
                "more than {MOST_POINTS} points: cut the bag into pieces"
            ));
        }
        self.clouds.push(Cloud {
            frame: message.header.frame_id.trim_start_matches('/').into(),
            stamp_ns: message.header.stamp.ns(),
            xyz,
        });
        Ok(())
    }
}

/// Calls `take` with every message of the file.
fn each_message(
    path: &Path,
    mut take: impl FnMut(&Arc<Channel<'static>>, &[u8]) -> Result<(), String>,
) -> Result<()> {
    let failed = |message: &dyn std::fmt::Display| Failure::file(path, message);
    let mut file = File::open(path).map_err(|e| failed(&e))?;
    let mut magic = [0; mcap::MAGIC.len()];
    let is_mcap = file.read_exact(&mut magic).is_ok() && magic == *mcap::MAGIC;
    if !is_mcap {
        return Err(failed(&"not an MCAP file"));
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = MessageReader::new_with_options(options);
    let mut messages = 0u64;
    while let Some(event) = reader.next_event() {
        match event {
            Ok(MessageReadEvent::ReadRequest(n)) => {
                let n = file.read(reader.insert(n.clamp(1, READ_BYTES)));
                reader.notify_read(n.map_err(|e| failed(&e))?);
            }
            Ok(MessageReadEvent::Message(message)) => {
                let taken = take(&message.channel, &message.data);
                taken.map_err(|e| failed(&format_args!("message {messages}: {e}")))?;
                messages += 1;
            }
            Err(McapError::UnexpectedEof) => {
                return Err(failed(&format_args!("truncated after {messages} messages")));
            }
            Err(error) => {
                return Err(failed(&format_args!(
                    "damaged after {messages} messages: {error}"
                )));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
