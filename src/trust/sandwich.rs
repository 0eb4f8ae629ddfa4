//! The cluster-robust covariance: what the scatter of whole groups of measurements shows, whatever each group has in common.
//!
//! The information matrix takes every residual for an independent fact. Where the residuals of a group share an error (a robot that stopped elsewhere, a
//! corner that is printed in the wrong place) that is too hopeful. The sandwich `C (sum g g^T) C` with one gradient `g` for each
//! group assumes nothing about what happens inside a group (Liang and Zeger, *Biometrika* 73, 1986). Residuals of a fit are smaller than
//! errors, most where a group decides much by itself, so each gradient is corrected by its own leverage (Bell and McCaffrey, *Survey
//! Methodology* 28, 2002). `(I - H_c C)^-1 g_c` (CR3) is what leaving the group out would change, the jackknife: it errs on the safe side whatever the
//! group's errors have in common, and makes the covariance. `(I - H_c C)^(-1/2) g_c` (CR2) has the exact expectation if they have nothing in
//! common: with it one can see whether they have.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::covariance::Covariance;
use crate::solve::terms::{Term, Terms};

/// Steps of the Lanczos process: enough for four digits of the correction at a leverage of 0.95.
const STEPS: usize = 20;
/// A leverage above this is taken for it: a group that alone decides something shows nothing about how sure that is.
const MOST_LEVERAGE: f64 = 0.99;
/// A scatter of gradients this many of its own standard deviations above what independent errors give is no chance.
const SHOWN: f64 = 4.0;

/// How the gradients of one kind of group scatter, in units of what each direction's independent errors would give.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scatter {
    /// Groups.
    pub groups: usize,
    /// The sum of the squared gradients, each measured by the covariance.
    pub found: f64,
    /// What that sum is on average if all errors are independent.
    pub expected: f64,
    /// The standard deviation of the sum in that case.
    pub spread: f64,
}

impl Scatter {
    /// Whether the measurements of a group have an error in common: more than independent errors would show once in many thousand cells.
    #[must_use]
    pub fn shown(&self) -> bool {
        self.found > self.expected + SHOWN * self.spread
    }

    /// How much larger the variance is than that of independent errors; 1 where there is nothing to tell from.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        if self.expected > 0.0 { self.found / self.expected } else { 1.0 }
    }
}

/// A cluster-robust covariance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sandwich {
    /// In units, of the determined part; `n x n`.
    pub matrix: DMatrix<f64>,
    /// The same, but groups of a kind that shows no error in common are taken for independent facts: less uncertain itself, and the information's own
    /// covariance where neither kind shows one.
    pub shown: DMatrix<f64>,
    /// How the configurations' gradients scatter.
    pub configurations: Scatter,
    /// How those of corners that never move do.
    pub corners: Scatter,
}

/// What a term adds: its gradient as the jackknife sees it (in units), and its scatter.
struct Adjusted {
    gradient: DVector<f64>,
    found: f64,
    expected: f64,
    variance: f64,
}

/// The sandwich around `covariance`, from the terms at the same state; `believed` is the information of the priors (row-major, natural units), which are
/// taken at their word. O(terms x k^3) for terms of k columns.
#[must_use]
pub fn sandwich(covariance: &Covariance, terms: &Terms, believed: &[f64]) -> Sandwich {
    let n = covariance.matrix.ncols();
    let kind = |terms: &[Term]| {
        let mut kind = Kind::new(n);
        kind.add(covariance, terms);
        kind
    };
    around(covariance, believed, [kind(&terms.configurations), kind(&terms.corners)])
}

/// What the terms of one kind of group add up to.
#[derive(Clone, Debug)]
pub(super) struct Kind {
    /// With the variance where the standard deviation belongs.
    scatter: Scatter,
    /// In units: the products of their gradients, and their information.
    products: DMatrix<f64>,
    information: DMatrix<f64>,
}

impl Kind {
    pub(super) fn new(n: usize) -> Self {
        Self { scatter: Scatter::default(), products: DMatrix::zeros(n, n), information: DMatrix::zeros(n, n) }
    }

    /// Adds terms, against a covariance of all of them.
    pub(super) fn add(&mut self, covariance: &Covariance, terms: &[Term]) {
        let (units, weight) = (covariance.units(), weight(covariance.noise));
        let (scatter, gradients) = adjust(terms, units, covariance.noise, &|i, j| covariance.matrix[(i, j)]);
        self.scatter.groups += scatter.groups;
        self.scatter.found += scatter.found;
        self.scatter.expected += scatter.expected;
        self.scatter.spread += scatter.spread.powi(2);
        for (term, gradient) in terms.iter().zip(&gradients) {
            for (i, &a) in term.columns.iter().enumerate() {
                for (j, &b) in term.columns.iter().enumerate() {
                    self.products[(a, b)] += gradient[i] * gradient[j];
                    self.information[(a, b)] += term.information[(i, j)] * units[a] * units[b] * weight;
                }
            }
        }
    }
}

/// The sandwich around `covariance`, from the sums of the configurations' terms and the still corners'.
pub(super) fn around(covariance: &Covariance, believed: &[f64], kinds: [Kind; 2]) -> Sandwich {
    let (n, units) = (covariance.matrix.ncols(), covariance.units());
    let symmetric = |i: usize, j: usize| 0.5 * (believed[i * n + j] + believed[j * n + i]) * units[i] * units[j];
    let mut all = DMatrix::from_fn(n, n, symmetric);
    let mut shown = all.clone();
    let [configurations, corners] = kinds.map(|kind| {
        let scatter = Scatter { spread: kind.scatter.spread.sqrt(), ..kind.scatter };
        shown += if scatter.shown() { &kind.products } else { &kind.information };
        all += kind.products;
        scatter
    });
    let around = |filling: DMatrix<f64>| &covariance.matrix * filling * &covariance.matrix;
    Sandwich { matrix: around(all), shown: around(shown), configurations, corners }
}

/// How the gradients of terms scatter, and the gradients as the jackknife sees them (in units). `entry` gives those of the covariance (in units) at which columns of one
/// term meet.
pub(super) fn adjust(
    terms: &[Term],
    units: &[f64],
    noise: f64,
    entry: &(dyn Fn(usize, usize) -> f64 + Sync),
) -> (Scatter, Vec<DVector<f64>>) {
    let all: Vec<Adjusted> = terms.par_iter().map(|term| adjusted(term, units, weight(noise), entry)).collect();
    let sum = Scatter {
        groups: terms.len(),
        found: all.iter().map(|a| a.found).sum(),
        expected: all.iter().map(|a| a.expected).sum(),
        spread: all.iter().map(|a| a.variance).sum::<f64>().sqrt(),
    };
    (sum, all.into_iter().map(|a| a.gradient).collect())
}

/// What the layout's weights are multiplied by to be those of the fitted noise.
fn weight(noise: f64) -> f64 {
    1.0 / noise.max(1e-9).powi(2)
}

fn adjusted(term: &Term, units: &[f64], weight: f64, entry: &(dyn Fn(usize, usize) -> f64 + Sync)) -> Adjusted {
    let k = term.columns.len();
    let unit = |i: usize| units[term.columns[i]];
    let own = DMatrix::from_fn(k, k, |i, j| entry(term.columns[i], term.columns[j]));
    let information = DMatrix::from_fn(k, k, |i, j| term.information[(i, j)] * unit(i) * unit(j) * weight);
    let gradient = DVector::from_fn(k, |i, _| term.gradient[i] * unit(i) * weight);
    let [halfway, whole] = undone(&information, &own, &gradient);
    let leverage = &information * &own;
    Adjusted {
        found: halfway.dot(&(&own * &halfway)),
        expected: leverage.trace(),
        variance: 2.0 * leverage.dot(&leverage.transpose()),
        gradient: whole,
    }
}

/// `(I - H C)^(-1/2) g` and `(I - H C)^-1 g` by the Lanczos process in the inner product of `C`, in which `H C` is self-adjoint with eigenvalues from 0 to 1 (Golub and Van
/// Loan, *Matrix Computations*, 10.2; only products with the matrices are needed).
fn undone(h: &DMatrix<f64>, c: &DMatrix<f64>, g: &DVector<f64>) -> [DVector<f64>; 2] {
    let cg = c * g;
    let length = g.dot(&cg).max(0.0).sqrt();
    if !(length.is_finite() && length > 1e-150) {
        return [g.clone(), g.clone()];
    }
    let (mut basis, mut dual) = (vec![g / length], vec![cg / length]);
    let (mut diagonal, mut beside): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    loop {
        let mut next = h * &dual[dual.len() - 1];
        diagonal.push(next.dot(&dual[dual.len() - 1]));
        // Twice, so that rounding does not bring back what has been there before.
        for _ in 0..2 {
            for (q, cq) in basis.iter().zip(&dual) {
                let along = next.dot(cq);
                next.axpy(-along, q, 1.0);
            }
        }
        let c_next = c * &next;
        let size = next.dot(&c_next).max(0.0).sqrt();
        if size < 1e-9 || diagonal.len() == STEPS.min(g.len()) {
            break;
        }
        beside.push(size);
        basis.push(next / size);
        dual.push(c_next / size);
    }
    let m = diagonal.len();
    let small = DMatrix::from_fn(m, m, |i, j| match (i.max(j), i.abs_diff(j)) {
        (_, 0) => diagonal[i],
        (high, 1) => beside[high - 1],
        _ => 0.0,
    });
    let eigen = small.symmetric_eigen();
    [0.5, 1.0].map(|power| {
        let mut result = DVector::zeros(g.len());
        for (i, q) in basis.iter().enumerate() {
            let along: f64 = (0..m)
                .map(|k| {
                    let v = eigen.eigenvectors.column(k);
                    v[i] * v[0] / (1.0 - eigen.eigenvalues[k].clamp(0.0, MOST_LEVERAGE)).powf(power)
                })
                .sum();
            result.axpy(along * length, q, 1.0);
        }
        result
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_of_a_group_s_leverage_is_that_of_the_eigenvalues() {
        // A covariance with correlations, and an information that is a part of its inverse.
        let root = DMatrix::from_fn(5, 5, |i, j| if i >= j { 1.0 / (1.0 + (i + 2 * j) as f64) } else { 0.0 });
        let c = &root * root.transpose();
        let whole = c.clone().try_inverse().unwrap();
        let factor = whole.cholesky().unwrap().l();
        let shares = DVector::from_vec(vec![0.9, 0.5, 0.1, 0.02, 0.3]);
        let h = &factor * DMatrix::from_diagonal(&shares) * factor.transpose();
        let g = DVector::from_fn(5, |i, _| (i as f64 - 1.7).sin());
        // With this choice I - H C = L (I - D) L^-1.
        let scaled = factor.clone().try_inverse().unwrap() * &g;
        for (found, power) in undone(&h, &c, &g).into_iter().zip([0.5, 1.0]) {
            let expected = &factor * scaled.zip_map(&shares, |x, share| x / f64::powf(1.0 - share, power));
            assert!((found - &expected).norm() < 1e-8 * expected.norm());
        }
    }
}
