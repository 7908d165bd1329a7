//! The benchmark of the closed loop: sets whose defect the loop does not know, and how often it says what was hidden.
//!
//! The sets come from [`hidden`], which shares no line with the effects that the loop fits; sensors, streets, noise and drop vary from
//! set to set. A set becomes a [`Row`], a line of JSON with the truth and the answer side by side; a [`Judgement`] is worked out from the
//! row alone, so that rows outlive the rules. The rules:
//!
//! - *Named*: the effect has exactly the defect's name. An effect for each ring in place of one for all rings, or the other way round, is
//!   another name. In the suite `single` the first effect has to have the name; where the name is among the ties of the first it is
//!   counted apart.
//! - *False name*: an added effect that is none of the defects, nor has one of them among its ties.
//! - *Within 10 %*: each [`Quantity`] of a named defect: the root mean square error is at most a tenth of the root mean square truth, which
//!   for one number is |found − truth| ≤ |truth| / 10. Gains count as deviations from 1. Amplitude and phase of a wave, and the components
//!   of a velocity, are one vector. Where another added effect shares the mean of a value for each ring, means are removed from both.
//! - *Covered*: the share of all numbers, quantities with means removed aside, for which value ± 1.96 standard errors holds the truth.
//! - `pairs`: each of the two is named, in whatever place, or among the ties of an added effect.
//! - `unknown`: the first unexplained dependence is of the defect's channel and has its covariates, one for one and no more.
//! - `nothing`: no effect and no unexplained dependence.
//! - `size`: named first, at sizes from 1/128 to twice the typical. Shares are made to rise with size by isotonic regression; the
//!   size at which one half or 95 % are found is interpolated on the logarithm of size.
//! - *Error removed*: on the confirm scenes, (before − after) / (before − ceiling) in the channels that the defect acts on, the least of
//!   them; the ceiling is that of the noise that was hidden, not of the noise that was found. Tables give the median over sets.
//! - A set that the loop refuses, or that makes it panic, is a set with no answer: nothing in it is right.
//!
//! Intervals of shares are Wilson's (Probable inference, the law of succession, and statistical inference, 1927), at 95 %.

mod case;
mod judge;
mod quantity;
mod removed;
mod row;
mod run;
mod share;
mod suite;
mod table;

pub use case::{Case, Extent};
pub use judge::Judgement;
pub use quantity::Quantity;
pub use row::{Answer, Dependence, Named, Numbers, Reply, Row, Step, Verdict, append, resume};
pub use run::{Run, run};
pub use share::{Share, size_found};
pub use suite::{NOTHINGS, Selection, Suite};
pub use table::table;
