#pragma once
// Pieces of an HTML page. All text is escaped here, and only here.

#include <string>
#include <string_view>
#include <vector>

namespace mesorig::report {

std::string Escaped(std::string_view text);

// Rows of text; the first row is the head. Cells that begin with a digit or a sign are set right.
std::string Table(const std::vector<std::vector<std::string>>& rows);
std::string Section(std::string_view heading, std::string_view body_html);
std::string Paragraph(std::string_view text);
// `file` is a relative path.
std::string Figure(std::string_view file, std::string_view caption);
std::string Figures(const std::vector<std::string>& figures_html);
std::string Page(std::string_view title, std::string_view subtitle, std::string_view body_html);

}  // namespace mesorig::report
