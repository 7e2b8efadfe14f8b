//! What the scanner says: poses, line segments, sweep ends, in the order of time.
//!
//! Every segment has a pose before its first and one after its last return, so a
//! receiver interpolates and never extrapolates; a segment is therefore due when the
//! pose that covers it is. Where all lines of a sweep start at the same time (a spinning
//! lidar) their segments are sent in turns, so that time does not run backwards.

use std::collections::VecDeque;
use std::sync::mpsc::sync_channel;

use heapless::Vec as Bounded;
use rugosa_wire::{BeamTable, MAX_RETURNS, MAX_TABLE, Message, ScanLine, SweepEnd};

use crate::scanner::{Line, Scanner};

/// A message and when it is due \[µs since the start of the scanner\].
#[derive(Clone, Debug, PartialEq)]
pub struct Stamped {
    /// when a real scanner would send it
    pub stamp_us: u64,
    /// what
    pub message: Message,
}

/// A scanner and what of its data is sent.
#[derive(Clone)]
pub struct Simulation {
    /// the scanner
    pub scanner: Scanner,
    /// how many sweeps; `None`: without end
    pub sweeps: Option<u32>,
    /// time from pose to pose \[µs\]
    pub pose_period_us: u64,
    /// are reflectances sent too?
    pub reflectances: bool,
}

impl Simulation {
    /// Endless, 100 poses a second, with reflectances.
    pub fn new(scanner: Scanner) -> Self {
        Simulation {
            scanner,
            sweeps: None,
            pose_period_us: 10_000,
            reflectances: true,
        }
    }

    /// Scanner description and beam tables: what a receiver must know before the first
    /// line.
    pub fn description(&self) -> Vec<Message> {
        let device = &self.scanner.device;
        let mut messages = vec![Message::Scanner(device.description.clone())];
        for (kind, angles) in &device.tables {
            let pieces = angles
                .chunks(MAX_TABLE)
                .enumerate()
                .map(|(i, piece)| BeamTable {
                    kind: *kind,
                    first: (i * MAX_TABLE) as u16,
                    angles_urad: piece.iter().copied().collect(),
                });
            messages.extend(pieces.map(Message::BeamTable));
        }
        messages
    }

    /// Poses, segments and sweep ends of all sweeps.
    pub fn messages(&self) -> Messages {
        Messages {
            simulation: self.clone(),
            sweep: 0,
            lines: None,
            ready: VecDeque::new(),
            poses: 0,
            segments: 0,
            due_us: 0,
        }
    }

    /// The same, made ahead of time on another thread, at most `ahead` messages.
    pub fn messages_ahead(&self, ahead: usize) -> impl Iterator<Item = Stamped> + Send + use<> {
        let messages = self.messages();
        let (sender, receiver) = sync_channel(ahead);
        std::thread::spawn(move || {
            for message in messages {
                if sender.send(message).is_err() {
                    break; // nobody wants the rest
                }
            }
        });
        receiver.into_iter()
    }

    fn cut(&self, line: &Line) -> Vec<ScanLine> {
        let device = &self.scanner.device;
        let period = u64::from(device.description.column_period_ns);
        let pieces = line
            .ranges
            .chunks(MAX_RETURNS)
            .zip(line.reflectances.chunks(MAX_RETURNS));
        let piece = |(i, (ranges, reflectances)): (usize, (&[u16], &[u16]))| {
            let first = i * MAX_RETURNS;
            let reflectances = if self.reflectances { reflectances } else { &[] };
            let pack = |values: &[u16]| device.packing.pack(values.iter().copied());
            ScanLine {
                sweep: line.sweep,
                line: line.line,
                first_column: first as u16,
                stamp_us: line.stamp_us + first as u64 * period / 1000,
                returns: ranges.len() as u16,
                packing: device.packing,
                // MAX_RETURNS values always fit
                ranges: pack(ranges).unwrap_or_default(),
                reflectances: pack(reflectances).unwrap_or(Bounded::new()),
            }
        };
        pieces.enumerate().map(piece).collect()
    }

    /// When the last return of a segment was taken \[µs\].
    fn segment_end(&self, segment: &ScanLine) -> u64 {
        let period = u64::from(self.scanner.device.description.column_period_ns);
        segment.stamp_us + (u64::from(segment.returns) * period).div_ceil(1000)
    }
}

/// The messages of a [`Simulation`], in the order of time.
pub struct Messages {
    simulation: Simulation,
    sweep: u32,
    lines: Option<Box<dyn Iterator<Item = Line> + Send>>,
    ready: VecDeque<Stamped>,
    poses: u64,
    segments: u16,
    due_us: u64,
}

impl Iterator for Messages {
    type Item = Stamped;

    fn next(&mut self) -> Option<Stamped> {
        while self.ready.is_empty() {
            if self
                .simulation
                .sweeps
                .is_some_and(|sweeps| self.sweep >= sweeps)
            {
                return None;
            }
            self.refill();
        }
        self.ready.pop_front()
    }
}

impl Messages {
    fn refill(&mut self) {
        let (scanner, sweep) = (&self.simulation.scanner, self.sweep);
        let lines = self
            .lines
            .get_or_insert_with(|| Box::new(scanner.sweep(sweep)));
        let at_once = match scanner.device.description.line_period_us {
            0 => usize::MAX,
            _ => 1,
        };
        let lines: Vec<Line> = lines.by_ref().take(at_once).collect();
        if lines.is_empty() {
            return self.end();
        }
        let mut segments: Vec<ScanLine> = lines
            .iter()
            .flat_map(|line| self.simulation.cut(line))
            .collect();
        segments.sort_by_key(|segment| segment.stamp_us);
        segments.into_iter().for_each(|segment| self.line(segment));
    }

    fn line(&mut self, segment: ScanLine) {
        let end_us = self.simulation.segment_end(&segment);
        let period = self.simulation.pose_period_us;
        while self.poses == 0 || (self.poses - 1) * period < end_us {
            let stamp_us = self.poses * period;
            let pose = self.simulation.scanner.robot.stamp(stamp_us);
            self.say(stamp_us, Message::Pose(pose));
            self.poses += 1;
        }
        self.segments += 1;
        self.say(end_us, Message::Line(segment));
    }

    fn end(&mut self) {
        let end = SweepEnd {
            sweep: self.sweep,
            stamp_us: self.due_us,
            lines: self.segments,
        };
        self.say(self.due_us, Message::SweepEnd(end));
        (self.sweep, self.lines, self.segments) = (self.sweep + 1, None, 0);
    }

    /// Nothing is due before what was said earlier.
    fn say(&mut self, stamp_us: u64, message: Message) {
        self.due_us = self.due_us.max(stamp_us);
        let stamp_us = self.due_us;
        self.ready.push_back(Stamped { stamp_us, message });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Device;
    use crate::robot::{Path, Robot};
    use crate::terrain::Plane;
    use std::sync::Arc;

    fn simulation(device: Device) -> Simulation {
        let path = Path::Straight {
            from: [0.0, 0.0],
            heading: 0.3,
            speed: 0.5,
        };
        let robot = Robot::new(Arc::new(Plane::FLAT), path);
        let mut simulation = Simulation::new(Scanner::new(device, robot, 1));
        simulation.sweeps = Some(3);
        simulation
    }

    fn check(simulation: &Simulation) {
        let device = &simulation.scanner.device;
        let (mut poses, mut lines, mut last_line, mut due) = (Vec::new(), 0, 0, 0);
        let mut returns = vec![0u32; 3];
        for Stamped { stamp_us, message } in simulation.messages() {
            assert!(stamp_us >= due);
            due = stamp_us;
            match message {
                Message::Pose(pose) => poses.push(pose.stamp_us),
                Message::Line(line) => {
                    assert!(line.stamp_us >= last_line, "time runs backwards");
                    last_line = line.stamp_us;
                    let span = simulation.segment_end(&line);
                    assert!(poses.iter().any(|&t| t <= line.stamp_us));
                    assert!(*poses.last().unwrap() >= span && stamp_us >= span);
                    assert_eq!(line.readings().unwrap().len(), usize::from(line.returns));
                    returns[line.sweep as usize] += u32::from(line.returns);
                    lines += 1;
                }
                Message::SweepEnd(end) => {
                    assert_eq!(end.lines, lines);
                    assert!(end.stamp_us >= last_line);
                    lines = 0;
                }
                other => panic!("{other:?}"),
            }
        }
        let beams = u32::from(device.description.lines) * u32::from(device.description.columns);
        assert_eq!(returns, [beams; 3]);
        assert!(poses.windows(2).all(|pair| pair[1] == pair[0] + 10_000));
    }

    #[test]
    fn every_return_is_sent_once_between_two_poses() {
        check(&simulation(Device::perceptron().thinned(32, 48)));
        check(&simulation(Device::lidar().thinned(64, 600)));
    }

    #[test]
    fn codes_survive_the_packing() {
        let mut simulation = simulation(Device::perceptron().thinned(16, 31));
        simulation.reflectances = true;
        let sent: Vec<Line> = simulation.scanner.sweep(0).collect();
        let got = simulation
            .messages()
            .filter_map(|stamped| match stamped.message {
                Message::Line(line) if line.sweep == 0 => Some(line),
                _ => None,
            });
        for (sent, got) in sent.iter().zip(got) {
            let codes: Vec<u16> = got
                .readings()
                .unwrap()
                .map(|r| got.packing.code(r))
                .collect();
            assert_eq!(codes, sent.ranges);
            let reflectances: Vec<u16> = got.reflectance_counts().unwrap().collect();
            assert_eq!(reflectances, sent.reflectances);
        }
    }

    #[test]
    fn the_description_has_every_table_entry() {
        let description = simulation(Device::lidar()).description();
        assert!(matches!(&description[0], Message::Scanner(s) if s.tables == 3));
        let entries = description[1..].iter().map(|message| match message {
            Message::BeamTable(table) => table.angles_urad.len(),
            _ => 0,
        });
        assert_eq!(entries.sum::<usize>(), 128);
    }

    #[test]
    fn making_ahead_changes_nothing_and_may_be_left_early() {
        let simulation = simulation(Device::perceptron().thinned(16, 16));
        assert!(simulation.messages().eq(simulation.messages_ahead(8)));
        assert_eq!(simulation.messages_ahead(2).take(3).count(), 3);
    }
}
