//! Recorded messages of a scanner, in the two parts that it sends them in.

use rugosa_wire::Message;

/// Splits what a scanner has sent into its description (each message once) and what it
/// measured, in order; all other messages are left out.
pub fn split(messages: impl IntoIterator<Item = Message>) -> (Vec<Message>, Vec<Message>) {
    let (mut description, mut measured) = (Vec::new(), Vec::new());
    for message in messages {
        match message {
            Message::Scanner(_) | Message::BeamTable(_) if description.contains(&message) => {}
            Message::Scanner(_) | Message::BeamTable(_) => description.push(message),
            Message::Line(_) | Message::Pose(_) | Message::SweepEnd(_) => measured.push(message),
            _ => {}
        }
    }
    (description, measured)
}
