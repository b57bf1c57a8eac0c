//! Polynomials in z.

use nalgebra::{Complex, DMatrix};

/// A polynomial, the highest power's coefficient first.
#[derive(Clone, Debug, PartialEq)]
pub struct Polynomial(pub Vec<f64>);

impl Polynomial {
    /// 1.
    pub fn one() -> Self {
        Self(vec![1.0])
    }

    /// z − `root`.
    pub fn root(root: f64) -> Self {
        Self(vec![1.0, -root])
    }

    /// The highest power.
    pub fn degree(&self) -> usize {
        self.0.len().saturating_sub(1)
    }

    /// Its value at `z`.
    pub fn at(&self, z: Complex<f64>) -> Complex<f64> {
        self.0.iter().fold(Complex::new(0.0, 0.0), |sum, coefficient| sum * z + coefficient)
    }

    /// `factor` times it.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self(self.0.iter().map(|coefficient| factor * coefficient).collect())
    }

    /// The product.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        let mut product = vec![0.0; self.0.len() + other.0.len() - 1];
        for (n, a) in self.0.iter().enumerate() {
            for (m, b) in other.0.iter().enumerate() {
                product[n + m] += a * b;
            }
        }
        Self(product)
    }

    /// The sum.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let (longer, shorter) = if self.0.len() >= other.0.len() { (self, other) } else { (other, self) };
        let mut sum = longer.0.clone();
        let shift = longer.0.len() - shorter.0.len();
        shorter.0.iter().enumerate().for_each(|(n, coefficient)| sum[shift + n] += coefficient);
        Self(sum)
    }

    /// Its roots, the largest modulus first.
    pub fn roots(&self) -> Vec<Complex<f64>> {
        let first = self.0.iter().position(|coefficient| *coefficient != 0.0).unwrap_or(self.0.len());
        let zeros = self.0.iter().rev().take_while(|coefficient| **coefficient == 0.0).count();
        let Some(kept) = self.0.get(first..self.0.len() - zeros.min(self.0.len() - first)) else { return Vec::new() };
        let degree = kept.len().saturating_sub(1);
        // The eigenvalues of the companion matrix.
        let companion = DMatrix::from_fn(degree, degree, |row, column| match (row, column) {
            (0, column) => -kept[column + 1] / kept[0],
            (row, column) if row == column + 1 => 1.0,
            _ => 0.0,
        });
        let mut roots: Vec<Complex<f64>> =
            if degree == 0 { Vec::new() } else { companion.complex_eigenvalues().iter().copied().collect() };
        roots.extend(core::iter::repeat_n(Complex::new(0.0, 0.0), if degree + zeros > 0 { zeros } else { 0 }));
        roots.sort_by(|a, b| modulus(*b).total_cmp(&modulus(*a)).then(b.im.total_cmp(&a.im)));
        roots
    }
}

/// |z|.
pub(crate) fn modulus(z: Complex<f64>) -> f64 {
    libm::hypot(z.re, z.im)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_what_the_polynomial_was_made_of() {
        let made = [0.99, -0.5, 0.25, 0.0].map(Polynomial::root);
        let product = made.iter().fold(Polynomial(vec![3.0]), |product, root| product.times(root));
        let roots = product.roots();
        let found: Vec<f64> = roots.iter().map(|root| root.re).collect();
        for (found, expected) in found.iter().zip([0.99, -0.5, 0.25, 0.0]) {
            assert!((found - expected).abs() < 1e-12, "{roots:?}");
        }
        assert!(roots.iter().all(|root| root.im.abs() < 1e-12) && roots.len() == 4);
    }

    /// Eq. 12 as printed: 1.01951 and 0.93849.
    #[test]
    fn the_poles_of_the_printed_model_are_real_and_one_is_unstable() {
        let roots = Polynomial(vec![1.0, -1.958, 0.9568]).roots();
        assert!((roots[0].re - 1.01951).abs() < 1e-5 && (roots[1].re - 0.93849).abs() < 1e-5, "{roots:?}");
    }
}
