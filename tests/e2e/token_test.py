"""palpate token: tokens as explore takes them, on standard output or in a file of one's own."""

import os
import re
import stat

import cli

LINES = re.compile(r"control ([a-z2-9]{26})\nview ([a-z2-9]{26})\n")


class Token(cli.PalpateTest):
    def test_two_lines_that_are_never_the_same(self):
        seen = set()
        for _ in range(5):
            match = LINES.fullmatch(self.succeed("token").stdout)
            self.assertTrue(match)
            seen.update(match.groups())
        self.assertEqual(len(seen), 10)

    def test_a_file_that_nobody_else_may_read(self):
        file = self.folder / "tokens"
        before = os.umask(0)
        try:
            done = self.succeed("token", "-o", file)
        finally:
            os.umask(before)
        self.assertEqual(done.stdout, "")
        self.assertEqual(stat.S_IMODE(file.stat().st_mode), 0o600)
        text = file.read_text()
        self.assertTrue(LINES.fullmatch(text))
        self.assertNotIn(LINES.fullmatch(text)[1], done.stderr)
        # and never over tokens that somebody has
        self.expect_error(cli.OUTPUT, "token", "-o", file, message="replacing it would revoke its tokens")
        self.assertEqual(file.read_text(), text)
        self.expect_error(cli.OUTPUT, "token", "-o", self.folder / "none" / "tokens")

    def test_one_of_a_role(self):
        self.assertRegex(self.succeed("token", "--role", "teacher").stdout, r"^teacher [a-z2-9]{26}\n$")
        line = self.succeed("token", "--role", "learner", "--learner", "L042").stdout
        self.assertRegex(line, r"^learner [a-z2-9]{26} L042\n$")
        self.expect_error(cli.USAGE, "token", "--role", "learner", message="--learner L042")
        self.expect_error(cli.USAGE, "token", "--learner", "L042", message="--role learner")
        self.expect_error(cli.BAD_INPUT, "token", "--role", "learner", "--learner", "a\nb", message="pseudonym")
        self.expect_error(cli.USAGE, "token", "--role", "admin", message="--role")
        # records are of somebody
        self.expect_error(cli.USAGE, "explore", "knee-phantom", "--records", self.folder / "r.db", message="--learner")

    def test_explore_takes_them(self):
        file = self.folder / "tokens"
        self.succeed("token", "-o", file)
        # the tokens pass, and what comes after them does not: before the knee is made, which takes its time
        said = self.expect_error(cli.BAD_INPUT, "explore", "knee-phantom", "--device", "pointer", "--seconds", "0.1",
                                 "--token-file", file, "--tls-cert", file, "--tls-key", file, message="certificate")
        self.assertNotIn(" %", said.stderr)
        file.chmod(0o600)
        file.write_text("view 12345678901234567890\n")
        said = self.expect_error(cli.BAD_INPUT, "explore", "knee-phantom", "--device", "pointer", "--seconds", "0.1",
                                 "--token-file", file, message="palpate token")
        self.assertNotIn(" %", said.stderr)


if __name__ == "__main__":
    cli.main()
