//! Soft and grown things: upholstery, cloth, fringes, leaves. Plain functions of numbers and pieces.
