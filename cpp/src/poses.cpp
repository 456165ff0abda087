// What rotavg::compiled holds (rotavg/compiled.hpp), what is left: positions.

#include <rotavg/poses/positions_impl.hpp>
