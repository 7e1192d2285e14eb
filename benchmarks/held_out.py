"""Quality on held-out traced scenes: ``python -m benchmarks.held_out --data shards data/planes_val``."""

from train.evaluate import main

if __name__ == "__main__":
    main()
