#include <rotavg/so3/lie.hpp>

rotavg::Matrix3 quarter_turn() { return rotavg::exp_so3({0.0, 0.0, 1.5707963267948966}); }
