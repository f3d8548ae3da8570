// Complaints of the OpenGL driver fail the test that drew (driver_complaints.cpp).
#pragma once

#include <string>
#include <vector>

namespace isobrick::test {

// While it lives, complaints fail nothing and are counted: for tests that provoke them. One at a
// time.
class ExpectedComplaints {
 public:
  ExpectedComplaints();
  ~ExpectedComplaints();
  ExpectedComplaints(const ExpectedComplaints&) = delete;
  ExpectedComplaints& operator=(const ExpectedComplaints&) = delete;

  // A line each.
  std::vector<std::string> heard() const;
};

}  // namespace isobrick::test
