// Client of a bokehnet process outside the host, and memory shared with it.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace bokehnet {

// Mapped file of this size; removed by the destructor.
class SharedMemory {
 public:
  explicit SharedMemory(std::size_t bytes);
  ~SharedMemory();
  SharedMemory(const SharedMemory &) = delete;
  SharedMemory &operator=(const SharedMemory &) = delete;

  float *at(std::size_t offset) const { return reinterpret_cast<float *>(static_cast<char *>(data_) + offset); }
  const std::string &path() const { return path_; }

 private:
  std::string path_;
  void *data_ = nullptr;
  std::size_t bytes_;
};

enum class Outcome { done, cancelled, failed };

// Send one request, the fields of a JSON object without braces, and wait for its outcome. The first request, and the next
// one after the process died, starts the process with the interpreter in BOKEHNET_PYTHON, otherwise python3. Requests
// are serialised.
//   progress      called with the completed fraction, 0 to 1
//   is_cancelled  called every 50 ms; the request is cancelled when it returns true
//   message       receives the reason of a failure, one line
Outcome request(const std::string &fields, const std::function<void(double)> &progress,
                const std::function<bool()> &is_cancelled, std::string &message);

}  // namespace bokehnet
