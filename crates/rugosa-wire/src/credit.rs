//! Flow control by credit: the receiver says how many long messages (scan lines and
//! beam tables) may be sent in all.
//!
//! Both sides count them from the start of the session, so a repeated or lost
//! [`Credit`] does no harm. Those that were lost on the way are found by the count in
//! the sender's [`crate::Heartbeat`], which it also sends while it waits for credit.

use crate::message::Credit;

/// Is `a` behind `b` on the circle of u32?
fn is_behind(a: u32, b: u32) -> bool {
    (b.wrapping_sub(a) as i32) > 0
}

/// The side that sends lines.
///
/// ```
/// use rugosa_wire::{Credit, credit::Spender};
/// let mut spender = Spender::default();
/// assert!(!spender.has_credit()); // nothing was granted yet
/// spender.granted(Credit { taken: 0, limit: 2 });
/// let sent = (0..5).filter(|_| spender.has_credit().then(|| spender.spend()).is_some());
/// assert_eq!(sent.count(), 2);
/// assert_eq!(spender.sent, 2);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spender {
    /// lines sent in this session
    pub sent: u32,
    limit: u32,
}

impl Spender {
    /// Takes over what the receiver granted.
    pub fn granted(&mut self, credit: Credit) {
        self.limit = credit.limit;
    }

    /// May one more line be sent?
    pub fn has_credit(&self) -> bool {
        is_behind(self.sent, self.limit)
    }

    /// A line was sent.
    pub fn spend(&mut self) {
        self.sent = self.sent.wrapping_add(1);
    }
}

/// The side that takes lines.
///
/// ```
/// use rugosa_wire::{Credit, credit::Granter};
/// let mut granter = Granter::default();
/// granter.offer(3);
/// assert_eq!(granter.due(), Some(Credit { taken: 0, limit: 3 }));
/// assert_eq!(granter.due(), None); // the sender knows
/// granter.took();
/// assert_eq!(granter.due(), Some(Credit { taken: 1, limit: 4 }));
/// // the sender says it has sent three: two are lost, and their room is free again
/// granter.reconcile(3);
/// assert_eq!(granter.due(), Some(Credit { taken: 3, limit: 6 }));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Granter {
    taken: u32,
    announced: u32,
    room: u16,
    asked: bool,
}

impl Granter {
    /// A line came in.
    pub fn took(&mut self) {
        self.taken = self.taken.wrapping_add(1);
    }

    /// The sender says how many lines it has sent: those that did not come are lost.
    /// It gets an answer.
    pub fn reconcile(&mut self, sent: u32) {
        (self.taken, self.asked) = (sent, true);
    }

    /// There is room for this many lines now.
    pub fn offer(&mut self, room: u16) {
        self.room = room;
    }

    /// The same room, in a new session of the sender.
    ///
    /// ```
    /// use rugosa_wire::{Credit, credit::Granter};
    /// let mut granter = Granter::default();
    /// granter.offer(3);
    /// granter.took();
    /// assert_eq!(granter.due(), Some(Credit { taken: 1, limit: 4 }));
    /// assert_eq!(granter.afresh().due(), Some(Credit { taken: 0, limit: 3 }));
    /// ```
    pub fn afresh(&self) -> Self {
        Granter {
            room: self.room,
            ..Granter::default()
        }
    }

    /// Lines granted so far.
    pub fn limit(&self) -> u32 {
        self.announced
    }

    /// The grant that is due: when asked for one, or when there is room for more than the
    /// sender knows of. Told at once, so that while the receiver is busy with something
    /// else the sender can use all of the room, not the half that it last heard of.
    pub fn due(&mut self) -> Option<Credit> {
        let limit = self.taken.wrapping_add(u32::from(self.room));
        if !self.asked && !is_behind(self.announced, limit) {
            return None;
        }
        (self.announced, self.asked) = (limit, false);
        Some(Credit {
            taken: self.taken,
            limit,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends while it may; `lose` says which lines and grants are lost.
    fn run(rounds: u32, lose: impl Fn(u32) -> bool) -> (u32, u32) {
        let (mut spender, mut granter, mut queue, mut worst) =
            (Spender::default(), Granter::default(), 0u16, 0);
        for round in 0..rounds {
            granter.offer(8 - queue);
            match granter.due() {
                Some(credit) if !lose(round) => spender.granted(credit),
                _ => {}
            }
            if spender.has_credit() {
                spender.spend();
                if !lose(round + 7) {
                    granter.took();
                    queue += 1;
                }
            } else {
                granter.reconcile(spender.sent);
            }
            worst = worst.max(u32::from(queue));
            queue = queue.saturating_sub((round % 3 == 0) as u16);
        }
        (spender.sent, worst)
    }

    #[test]
    fn the_queue_never_overruns_and_never_starves() {
        let (sent, worst) = run(3000, |_| false);
        assert!(
            (1000..1010).contains(&sent),
            "{sent} lines at one per three rounds"
        );
        assert_eq!(worst, 8);
    }

    #[test]
    fn lost_lines_and_grants_do_not_use_up_the_credit() {
        let (sent, worst) = run(30_000, |round| round % 11 < 4);
        assert!(sent > 9_000 && worst <= 8, "{sent} lines, queue {worst}");
    }

    #[test]
    fn the_sender_knows_of_all_the_room_there_is() {
        let (mut spender, mut granter) = (Spender::default(), Granter::default());
        granter.offer(8);
        for taken in 0..100 {
            let credit = granter.due().unwrap();
            let limit = taken + 8;
            assert_eq!(credit, Credit { taken, limit });
            assert_eq!(granter.due(), None, "told already");
            spender.granted(credit);
            spender.spend();
            granter.took(); // and worked off at once
        }
    }

    #[test]
    fn counting_goes_on_across_the_wrap() {
        let mut spender = Spender {
            sent: u32::MAX,
            limit: 0,
        };
        assert!(
            !Spender {
                sent: 0,
                limit: u32::MAX
            }
            .has_credit()
        );
        spender.granted(Credit { taken: 0, limit: 1 });
        spender.spend();
        assert!(spender.has_credit());
        spender.spend();
        assert!(!spender.has_credit());
    }
}
