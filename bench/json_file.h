#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace palpate::bench {

/// Writes a program's figures to `path`, and nothing where it is empty. The program's exit code: 0, or 4 and
/// a line on stderr where the file could not be written.
int write_json(const std::string& program, const std::string& path, const nlohmann::json& figures);

}  // namespace palpate::bench
