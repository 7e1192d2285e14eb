"""Quality on held-out scenes: ``python -m benchmarks.quality.held_out --data shards data/planes_val``."""

from train.evaluate import main

if __name__ == "__main__":
    main()
