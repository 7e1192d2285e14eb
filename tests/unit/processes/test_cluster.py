"""Tasks on a cluster, by one that ends them in an order of its own. Authority: the arguments themselves."""

from bokehnet.processes.cluster import results_as_completed, results_in_order


class Ray:
    """A cluster that ends the newest task first."""

    def __init__(self):
        self.under_way, self.most, self.cancelled = [], 0, []

    def remote(self, **options):
        assert options == {"num_cpus": 1, "max_retries": -1}

        def decorated(work):
            class Task:
                @staticmethod
                def remote(argument):
                    results = (len(self.under_way), work(argument))
                    self.under_way.append(results)
                    self.most = max(self.most, len(self.under_way))
                    return (argument, results[1])

            return Task

        return decorated

    def wait(self, running, num_returns):
        return [running[-1]], running[:-1]

    def get(self, result):
        self.under_way.pop()
        return result[1]

    def cancel(self, result, force):
        assert force
        self.cancelled.append(result[0])


def square(x):
    return x * x


def test_each_task_is_given_once_with_its_name_and_few_are_under_way():
    ray = Ray()
    result = list(results_as_completed(ray, square, [(f"n{x}", x) for x in range(7)], 3))
    assert sorted(result) == [(f"n{x}", x * x) for x in range(7)]
    assert result[0][0] == "n2"  # the newest of three
    assert (ray.most, ray.cancelled) == (3, [])


def test_order_is_kept_where_it_is_requested():
    ray = Ray()
    assert list(results_in_order(ray, square, range(7), 3)) == [x * x for x in range(7)]
    assert (ray.most, ray.cancelled) == (3, [])


def test_what_is_under_way_is_given_up_when_the_caller_stops():
    ray = Ray()
    answers = results_as_completed(ray, square, enumerate(range(7)), 3)
    next(answers)
    answers.close()
    assert ray.cancelled == [0, 1]
    ray = Ray()
    answers = results_in_order(ray, square, range(7), 3)
    next(answers)
    answers.close()
    assert ray.cancelled == [1, 2]
