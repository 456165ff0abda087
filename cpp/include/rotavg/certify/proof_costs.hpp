#pragma once

namespace rotavg {

/// By what a factorisation, which is certain, is chosen before a random start, which is not quite.
struct ProofCosts {
  /// A factorisation of so many operations is made before anything else is tried,
  static constexpr double quick = 1e8;
  /// and one of so many before the connectivity of a dense graph.
  static constexpr double no_time = 1e7;
  static constexpr double worth_certainty = 3.0;   ///< how many times a random start may be quicker
  static constexpr double usual_products = 130.0;  ///< of that, on a well connected graph
};

}  // namespace rotavg
