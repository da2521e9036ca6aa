//! What a cloth meets: a distance grid.
