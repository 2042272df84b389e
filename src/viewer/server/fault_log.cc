#include "server/fault_log.h"

namespace palpate::server {

void FaultLog::add(std::string_view who, std::string_view fault, Clock::time_point now) {
  if (!log_) return;
  catch_up(now);
  if (lines_ == 0) begun_ = now;
  if (++lines_ > kLinesEachSecond) {
    ++left_out_;
    return;
  }
  std::string line = "viewer ";
  line += who;
  line += ": ";
  line += fault;
  log_(line);
}

void FaultLog::catch_up(Clock::time_point now) {
  if (!log_ || lines_ == 0 || now - begun_ < std::chrono::seconds(1)) return;
  if (left_out_ > 0) log_("viewers: " + std::to_string(left_out_) + " more faults");
  lines_ = left_out_ = 0;
}

}  // namespace palpate::server
