//! Sharing work out among threads, or doing it on this one without waking any other: a small problem does not even start the pool.

use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::assemble::Scratch;

/// Does something with each of many things.
pub(super) fn each<T: Send>(alone: bool, things: &mut [T], act: impl Fn(&mut T) + Send + Sync) {
    if alone {
        things.iter_mut().for_each(act);
    } else {
        // Each can be taken by whoever has nothing to do: a unit takes far longer than to hand it over.
        things.par_iter_mut().with_max_len(1).for_each(act);
    }
}

/// Finds a number for each of many things.
pub(super) fn find<T: Sync>(alone: bool, things: &[T], found: &mut [f64], of: impl Fn(&T) -> f64 + Send + Sync) {
    if alone {
        things.iter().zip(found).for_each(|(thing, found)| *found = of(thing));
    } else {
        things.par_iter().zip(found).for_each(|(thing, found)| *found = of(thing));
    }
}

/// Room to expand blocks, for each thread its own.
#[derive(Debug, Default)]
pub(super) struct Rooms(Vec<Mutex<Scratch>>);

impl Rooms {
    /// Makes room for as many threads as will share the work; nothing happens if it is there.
    pub(super) fn fit(&mut self, alone: bool, make: impl Fn() -> Scratch) {
        let threads = if alone { 1 } else { rayon::current_num_threads() };
        while self.0.len() < threads {
            self.0.push(Mutex::new(make()));
        }
    }

    /// This thread's room.
    pub(super) fn own(&self) -> MutexGuard<'_, Scratch> {
        let thread = rayon::current_thread_index().unwrap_or(0) % self.0.len();
        self.0[thread].lock().unwrap_or_else(PoisonError::into_inner)
    }
}
