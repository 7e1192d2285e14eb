// A warm bokehnet process beside the host, and memory that both share.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace bokehnet {

// A file of this size in memory, mapped; gone with the object.
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

// Sends one request, the JSON object's fields without braces, and waits for its end. The process is started at the first
// one, by the interpreter that BOKEHNET_PYTHON names, else python3, and again when it died. One request at a time.
//   progress  is told the share that is done, 0 to 1
//   unwanted  is asked every 50 ms; once it says yes, the request is cancelled
//   message   why it failed, one line
Outcome request(const std::string &fields, const std::function<void(double)> &progress,
                const std::function<bool()> &unwanted, std::string &message);

}  // namespace bokehnet
