#include "dense.hpp"

#include <Eigen/Eigenvalues>

namespace rotavg::test {

Eigen::VectorXd dense_eigenvalues(const Eigen::MatrixXd& symmetric) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(symmetric, Eigen::EigenvaluesOnly)
      .eigenvalues();
}

}  // namespace rotavg::test
