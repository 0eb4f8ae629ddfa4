//! A few of many, spread evenly, when it is not known beforehand how many there are.

/// Numbers kept at most.
const MOST: usize = 64;

/// Every so many-th of the numbers that came by, never many: when there are too many, every other one is let go.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Evenly {
    kept: Vec<u64>,
    /// Numbers that came by, and how many of them make one that is kept.
    count: u64,
    halvings: u32,
    last: Option<u64>,
}

impl Evenly {
    /// Lets a number come by; the same one twice in a row counts once.
    pub(super) fn note(&mut self, number: u64) {
        if self.last.replace(number) == Some(number) {
            return;
        }
        if self.count.is_multiple_of(1 << self.halvings) {
            if self.kept.len() == MOST {
                let mut place = 0;
                self.kept.retain(|_| {
                    place += 1;
                    place % 2 == 1
                });
                self.halvings += 1;
            }
            if self.count.is_multiple_of(1 << self.halvings) {
                self.kept.push(number);
            }
        }
        self.count += 1;
    }

    /// How many came by.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// At most so many of those that are kept, spread evenly.
    pub fn some(&self, most: usize) -> impl Iterator<Item = u64> + '_ {
        let most = most.clamp(1, MOST);
        let take = self.kept.len().min(most);
        (0..take).map(move |i| self.kept[i * self.kept.len() / take])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_spread_over_all_that_came_by() {
        for count in [1u64, 5, 63, 64, 65, 200, 1000, 12_345] {
            let mut some = Evenly::default();
            (0..count).for_each(|number| {
                some.note(number);
                some.note(number);
            });
            assert_eq!(some.count(), count);
            let kept: Vec<u64> = some.some(20).collect();
            assert_eq!(kept.len() as u64, count.min(20));
            let widest = kept.iter().zip(kept.iter().skip(1).chain([&count])).map(|(a, b)| b - a).max().unwrap();
            assert!(kept[0] == 0 && widest <= 1 + 4 * count / 20, "{count}: {kept:?}");
        }
    }
}
