// What rotavg::compiled holds (rotavg/compiled.hpp), the last part: online averaging.

#include <rotavg/online/online_impl.hpp>
