#include "palpate/base/utc.h"

#include <chrono>
#include <cmath>
#include <ctime>

namespace palpate {
namespace {

constexpr const char* kForm = "%Y-%m-%dT%H:%M:%SZ";

std::string utc_text(std::time_t time) {
  std::tm utc{};
  if (gmtime_r(&time, &utc) == nullptr) return "";
  char text[32];
  return {text, std::strftime(text, sizeof text, kForm, &utc)};
}

}  // namespace

std::string utc_now() {
  return utc_text(std::chrono::system_clock::to_time_t(std::chrono::system_clock::now()));
}

std::string utc_after(const std::string& utc, double after_s) {
  constexpr double kMax_s = 1e10;  // some 300 years
  std::tm parts{};
  const char* const end = strptime(utc.c_str(), kForm, &parts);
  if (end == nullptr || *end != '\0' || !(after_s >= 0 && after_s < kMax_s)) return utc;
  return utc_text(timegm(&parts) + static_cast<std::time_t>(std::floor(after_s)));
}

}  // namespace palpate
