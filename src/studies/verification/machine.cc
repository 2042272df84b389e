#include "verification/machine.h"

#include <ctime>
#include <fstream>
#include <thread>

#include "palpate/volume/simd_targets.h"
#include "palpate_version.h"

namespace palpate {
namespace {

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    if (!line.starts_with("model name")) continue;
    const auto value = line.find_first_not_of(" \t", line.find(':') + 1);
    if (value != std::string::npos) return line.substr(value);
  }
  return "unknown processor";
}

}  // namespace

std::string machine_description() {
  const unsigned cores = std::thread::hardware_concurrency();
  return processor() + ", " + std::to_string(cores) + (cores == 1 ? " core" : " cores") + ", SIMD " +
         simd_targets().front();
}

std::string build_description() {
  std::string text = std::string("palpate ") + PALPATE_VERSION + ", commit " + PALPATE_COMMIT + ", " +
                     PALPATE_BUILD_TYPE + ", " + PALPATE_COMPILER;
  const std::string sanitizers = PALPATE_SANITIZERS;
  if (!sanitizers.empty()) text += ", sanitizers " + sanitizers;
  return text;
}

std::string today() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  char text[16];
  std::strftime(text, sizeof text, "%Y-%m-%d", &utc);
  return text;
}

}  // namespace palpate
