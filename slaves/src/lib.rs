//! The slaves.
