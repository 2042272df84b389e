// Receives every tick of a running session: the largest force, and what did not come. A console program for mono and .NET;
// in Unity the loop's body stands in a thread, and Update reads the last tick that it has stored.
using System;
using Palpate;

static class WatchTicks
{
    /// <param name="words">the address, "ws://127.0.0.1:8480/ws", and the number of ticks</param>
    static int Main(string[] words)
    {
        long wanted = long.Parse(words[1]), ticks = 0;
        double most = 0;
        ulong lost = 0, last = 0;
        using (var viewer = new Viewer(words[0]))
        {
            for (var bundle = viewer.Receive(); bundle != null && ticks < wanted; bundle = viewer.Receive())
            {
                foreach (var tick in bundle.Ticks) most = Math.Max(most, tick.Device[0].ForceN.Length);
                ticks += bundle.Ticks.Length;
                lost = bundle.Lost;
                last = bundle.Ticks[bundle.Ticks.Length - 1].Tick;
            }
        }
        Console.WriteLine("{0} ticks to {1}, {2} lost, {3:F2} N at most", ticks, last, lost, most);
        return 0;
    }
}
