#include "warm.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <vector>

namespace bokehnet {

namespace {

constexpr int kPollMs = 50;

class Process {
 public:
  ~Process() { stop(); }

  void start() {
    if (pid_ > 0) return;
    int down[2], up[2];
    if (pipe2(down, O_CLOEXEC) != 0) throw std::runtime_error("cannot make a pipe");
    if (pipe2(up, O_CLOEXEC) != 0) {
      close(down[0]);
      close(down[1]);
      throw std::runtime_error("cannot make a pipe");
    }
    const char *variable = std::getenv("BOKEHNET_PYTHON");
    const std::string python = variable != nullptr && *variable != 0 ? variable : "python3";
    pid_ = fork();
    if (pid_ == 0) {
      dup2(down[0], STDIN_FILENO);
      dup2(up[1], STDOUT_FILENO);
      // -P: no modules of the current folder, which may come with a project from others.
      execlp(python.c_str(), python.c_str(), "-P", "-m", "bokehnet.integrations.warm",
             static_cast<char *>(nullptr));
      _exit(127);
    }
    close(down[0]);
    close(up[1]);
    in_ = down[1];
    out_ = up[0];
    std::string line;
    while (pid_ > 0 && !read_line(line, kPollMs)) {
    }
    if (line.find("\"ready\"") == std::string::npos) {
      stop();
      throw std::runtime_error("BOKEHNET_PYTHON: expected a Python with bokehnet, found " + python +
                               "; pip install bokehnet there, or name another one");
    }
  }

  void stop() {
    if (in_ >= 0) close(in_);
    if (out_ >= 0) close(out_);
    if (pid_ > 0) {
      kill(pid_, SIGTERM);
      waitpid(pid_, nullptr, 0);
    }
    in_ = out_ = -1;
    pid_ = -1;
    buffer_.clear();
  }

  void send(const std::string &text) {
    const std::string line = text + "\n";
    std::size_t sent = 0;
    while (sent < line.size()) {
      const ssize_t now = write(in_, line.data() + sent, line.size() - sent);
      if (now <= 0) throw std::runtime_error("bokehnet: expected a running process, found none; try again");
      sent += static_cast<std::size_t>(now);
    }
  }

  // Return whether a complete line arrived within the time; at the end of the output the process is stopped.
  bool read_line(std::string &line, int wait_ms) {
    std::size_t end;
    while ((end = buffer_.find('\n')) == std::string::npos) {
      pollfd ready{out_, POLLIN, 0};
      if (poll(&ready, 1, wait_ms) <= 0) return false;
      char part[4096];
      const ssize_t count = read(out_, part, sizeof part);
      if (count <= 0) {
        stop();
        return false;
      }
      buffer_.append(part, static_cast<std::size_t>(count));
    }
    line = buffer_.substr(0, end);
    buffer_.erase(0, end + 1);
    return true;
  }

  bool alive() const { return pid_ > 0; }

 private:
  pid_t pid_ = -1;
  int in_ = -1, out_ = -1;
  std::string buffer_;
};

// Return the string field of a flat JSON line written by Python; empty if it is absent.
std::string text_of(const std::string &json, const std::string &name) {
  const std::string key = "\"" + name + "\": \"";
  std::size_t position = json.find(key);
  std::string text;
  if (position == std::string::npos) return text;
  for (position += key.size(); position < json.size() && json[position] != '"'; ++position) {
    if (json[position] == '\\' && position + 1 < json.size()) ++position;
    text += json[position];
  }
  return text;
}

double number_of(const std::string &json, const std::string &name) {
  const std::string key = "\"" + name + "\": ";
  const std::size_t position = json.find(key);
  return position == std::string::npos ? 0 : std::strtod(json.c_str() + position + key.size(), nullptr);
}

std::mutex request_mutex;
Process process;
unsigned long number = 0;

}  // namespace

SharedMemory::SharedMemory(std::size_t bytes) : bytes_(bytes) {
  std::string name = access("/dev/shm", W_OK) == 0 ? "/dev/shm/bokehnet-XXXXXX" : "/tmp/bokehnet-XXXXXX";
  const int file = mkstemp(name.data());
  if (file < 0) throw std::runtime_error("cannot make a file in " + name);
  path_ = name;
  const bool allocated = posix_fallocate(file, 0, static_cast<off_t>(bytes)) == 0;
  if (allocated) data_ = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  close(file);
  if (!allocated || data_ == MAP_FAILED) {
    unlink(path_.c_str());
    throw std::runtime_error("expected space for " + std::to_string(bytes >> 20) + " MiB, found none at " + path_);
  }
}

SharedMemory::~SharedMemory() {
  munmap(data_, bytes_);
  unlink(path_.c_str());
}

Outcome request(const std::string &fields, const std::function<void(double)> &progress,
                const std::function<bool()> &is_cancelled, std::string &message) {
  const std::lock_guard<std::mutex> lock(request_mutex);
  signal(SIGPIPE, SIG_IGN);
  try {
    process.start();
    const std::string id = std::to_string(++number);
    process.send("{\"id\": " + id + ", " + fields + "}");
    const std::string prefix = "{\"id\": " + id + ", ";
    bool cancel_sent = false;
    std::string line;
    while (true) {
      if (!process.read_line(line, kPollMs)) {
        if (!process.alive()) throw std::runtime_error("bokehnet: expected an answer, found its process ended; try again");
        if (!cancel_sent && is_cancelled()) {
          process.send("{\"cancel\": " + id + "}");
          cancel_sent = true;
        }
        continue;
      }
      if (line.compare(0, prefix.size(), prefix) != 0) continue;
      if (line.find("\"result\": ") != std::string::npos) return Outcome::done;
      if (line.find("\"error\": ") != std::string::npos) {
        message = text_of(line, "message");
        return message == "cancelled" ? Outcome::cancelled : Outcome::failed;
      }
      const double total = number_of(line, "total");
      if (total > 0) progress(number_of(line, "done") / total);
      if (!cancel_sent && is_cancelled()) {
        process.send("{\"cancel\": " + id + "}");
        cancel_sent = true;
      }
    }
  } catch (const std::exception &error) {
    process.stop();
    message = error.what();
    return Outcome::failed;
  }
}

}  // namespace bokehnet
