//! Nothing. See CHANGED.md.
