//! Effects against values computed by hand.
