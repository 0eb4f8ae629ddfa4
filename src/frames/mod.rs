//! The frame tree: who is mounted on what, paths between frames, and who is tied to whom by measurements.
//!
//! Every frame hangs on one parent by one edge: a static pose (known or to be found), a pose of its own at each configuration, or
//! a link of a robot. A measurement compares something in one frame with something in another, so all that the solver ever needs is
//! a [`Path`] between two frames; eye-in-hand, eye-on-base, several robots and moving boards are the same code.

mod path;
mod pieces;
mod tree;

pub use path::{Path, Step};
pub use pieces::{Pieces, pieces};
pub use tree::{Edge, Frame, FrameId, FrameTree, Freedom, MovingEdge, StaticEdge};
