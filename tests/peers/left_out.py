"""Tests of the peers about rotations that have no equivalent here, and why."""

from __future__ import annotations

# suite, tests, reason
LEFT_OUT: tuple[tuple[str, str, str], ...] = (
    (
        "COLMAP",
        "rotation_averaging_test: unknown rigs (WithoutNoiseWithNonTrivialUnknownRig, "
        "GravityWithUnknownRigSensorsReturnsFalse, InitializeSensorFromRig*, "
        "RefineSensorFromRigFalsePreservesRig, MultiImageRigFrameDeregister*)",
        "of the drop-in and of rigs: tests/python/test_colmap_drop_in.py, test_rigs.py",
    ),
    (
        "COLMAP",
        "rotation_averaging_test: RidgeRegularizationDoesNotBiasSolution",
        "there is no such regularisation to switch on: the proof bounds any bias",
    ),
    (
        "COLMAP",
        "pose_graph_test, motion_averaging_test.py",
        "pycolmap's own containers and option objects, which are used as they are",
    ),
    (
        "GLOMAP",
        "rotation_averager_test: all seven",
        "the same scenes and bounds as COLMAP's, which took them over: the rows above",
    ),
    (
        "GTSAM",
        "testShonanAveraging: checkConstructor, buildGraphAt, LiftTo, TangentVectorValues, "
        "initializeWithDescent; testShonanFactor; testShonanGaugeFactor",
        "the insides of its lifted factor graphs; our staircase: tests/cpp/test_staircase.cpp",
    ),
    (
        "GTSAM",
        "testInitializePose3: buildPose3graph, createSymbolicGraph, singleGradient, "
        "iterationGradient, orientationsGradient",
        "iterates of one gradient method, digit by digit; its limit is the first row of this file",
    ),
    (
        "GTSAM",
        "testInitializePose: computePoses2D",
        "the cost after one step of its solver from given angles; our optimum: largeGraphNoisy",
    ),
    (
        "GTSAM",
        "testLago: findMinimumSpanningTree, checkSTandChords, orientationsOverSpanningTree, "
        "regularizedMeasurements",
        "the insides of LAGO's unwrapping of angles, which rotations do not need",
    ),
    (
        "GTSAM",
        "testKarcherMeanFactor: FindSO4, FactorSO4; testFrobeniusFactor: SO4",
        "rotations of four dimensions have no use here outside the staircase",
    ),
    (
        "GTSAM",
        "testPoseRotationPrior, testRotateFactor, testRot3, testRot2, testPreintegratedRotation",
        "classes for factors and groups; priors: tests/python/test_priors.py",
    ),
    (
        "Theia",
        "rotation_test, l1_solver_test, tests of relative poses from points",
        "geometry before averaging, and a solver's insides",
    ),
    (
        "OpenMVG",
        "translation_averaging_test, l1_solver_test",
        "translations without scale, and a solver's insides",
    ),
    (
        "GraphOptim",
        "rotation_test, rotation_utils_test, view_graph_test",
        "conversions and containers: tests/python/test_conventions.py",
    ),
    (
        "GTSFM",
        "test_averaging_1dsfm.py, test_1dsfm_reproducibility.py",
        "translations without scale",
    ),
    (
        "DPGO",
        "testPGO: testRobustSinglePoseAveraging*",
        "outliers among translations: robust losses here are of rotations",
    ),
    (
        "DPGO",
        "testPoses, testUtils, testEigenMap, testOptimizationThread (Basic)",
        "classes for lifted poses and agents",
    ),
    (
        "SE-Sync",
        "none: its repository has examples, and no tests",
        "what it solves, poses, is refine_poses here: docs/pose_graphs.md",
    ),
    (
        "SciPy",
        "test_rotation.py: test_align_vectors*, test_rigid_transform.py, test_rotation_spline.py",
        "vectors, poses and curves instead of sets of rotations",
    ),
)
