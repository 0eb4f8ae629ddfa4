//! Robot models that come with the program: the files in `layouts/robots/`.

macro_rules! models {
    ($($name:literal),* $(,)?) => {
        const MODELS: &[(&str, &str)] = &[$(($name, include_str!(concat!("../../layouts/robots/", $name, ".yaml")))),*];
    };
}

models!("ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e", "ur20", "ur30");

/// The model file of a built-in robot.
#[must_use]
pub fn robot_model(name: &str) -> Option<&'static str> {
    MODELS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The names of all built-in robots.
pub fn robot_names() -> impl Iterator<Item = &'static str> + Clone {
    MODELS.iter().map(|(name, _)| *name)
}
