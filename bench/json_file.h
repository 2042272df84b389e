#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace palpate::bench {

/// Writes a program's figures to `path`, or nothing if that is empty. Returns the program's exit code: 0, or
/// 4 with a message on stderr if the file could not be written.
int write_json(const std::string& program, const std::string& path, const nlohmann::json& figures);

}  // namespace palpate::bench
