#!/bin/sh
# What wheels are built with in a manylinux container: SuiteSparse, and Eigen 3.4, as the
# distribution's is older.
set -eu
dnf install -y suitesparse-devel
eigen=3.4.0
curl -fsSL "https://gitlab.com/libeigen/eigen/-/archive/$eigen/eigen-$eigen.tar.gz" | tar xz -C /tmp
cmake -S "/tmp/eigen-$eigen" -B /tmp/eigen-build -DBUILD_TESTING=OFF -DEIGEN_BUILD_DOC=OFF
cmake --install /tmp/eigen-build
