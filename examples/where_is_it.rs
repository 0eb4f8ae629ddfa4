//! Where does the arm's flange stand in the world at a configuration? FK of a built-in robot, composed with a base pose by names that cancel.
//!
//! `cargo run --release --example where_is_it`

use cellmap::geometry::Pose;
use cellmap::geometry::rotation;
use cellmap::layout::{builtin, parse_model};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = builtin::robot_model("ur5e").ok_or("ur5e is built in")?;
    let chain = parse_model("ur5e.yaml".as_ref(), text, None).map_err(|complaints| complaints[0].to_string())?;
    let joints = [0.0, -90.0, 90.0, -90.0, -90.0, 0.0].map(f64::to_radians);

    let world_from_base = Pose::new(rotation::from_rpy([0.0, 0.0, 0.5]), [0.3, 0.1, 0.8].into());
    let base_from_flange = chain.base_from_flange(&joints);
    let world_from_flange = world_from_base * base_from_flange;

    let t = world_from_flange.translation * 1e3;
    println!("world_from_flange: {:.1} {:.1} {:.1} mm", t.x, t.y, t.z);
    Ok(())
}
